"""A recording of one moving joint, by an integrator of the tests' own: small steps of one second-order servo."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_math.arrays import Array

FPS, FINE, JOINT = 30, 40, 1
ENCODER = 2.0 * np.pi / 4096.0


@cache
def recording(
    seconds: float = 66.0,
    frequency: float = 4.0,
    damping: float = 0.8,
    friction: float = 0.0,
    late: int = 0,
    offset: float = 0.01,
    drag: float = 0.0,
    speed: float = np.inf,
) -> LeRobotFrames:
    """Six episodes in which joint 2 of five moves. `friction`: rad; `late`: frames of dead time.

    `drag`: rad at 1 rad/s, with the square of speed. `speed`: rad/s, the largest of the set-point.
    """
    rng = np.random.default_rng(3)
    episodes = 6
    count = int(FPS * seconds / episodes)
    command, reading = [], []
    for _ in range(episodes):
        told = _told(rng, count)
        command.append(told)
        reading.append(_followed(told, frequency, damping, friction, late, drag, speed) + offset)
    q = np.zeros((2, episodes * count, 5))
    q[0, :, JOINT], q[1, :, JOINT] = np.concatenate(command), np.concatenate(reading)
    noise = 0.4 * ENCODER * rng.normal(size=q[1].shape)
    read = np.round((q[1] + noise) / ENCODER) * ENCODER
    t, episode = np.tile(np.arange(count) / FPS, episodes), np.repeat(np.arange(episodes), count)
    return LeRobotFrames(q[0], read, t, episode)


def _told(rng: np.random.Generator, count: int) -> Array:
    rows, q = [0.0] * 20, 0.0
    while len(rows) < count:
        goal = rng.uniform(-0.7, 0.7)
        s = np.linspace(0.0, 1.0, int(FPS * rng.uniform(0.4, 1.2)))
        rows += [*(q + (goal - q) * s * s * (3.0 - 2.0 * s)), *([goal] * int(FPS * rng.uniform(0.3, 0.8)))]
        q = goal
    return np.array(rows[:count])


def _followed(
    told: Array, frequency: float, damping: float, friction: float, late: int, drag: float, speed: float
) -> Array:
    omega, h = 2.0 * np.pi * frequency, 1.0 / FPS / FINE
    braking = damping * omega * h
    q, v, out, goal = float(told[0]), 0.0, [], float(told[0])
    for k in range(len(told)):
        out.append(q)
        wanted = float(told[max(k - late, 0)])
        for _ in range(FINE):
            goal += min(max(wanted - goal, -speed * h), speed * h)
            then = ((1.0 - braking) * v + h * omega**2 * (goal - q)) / (1.0 + braking)
            rub = h * omega**2 * (friction + drag * v * v)
            v = 0.0 if abs(then) <= rub else then - math.copysign(rub, then)
            q += h * v
    return np.array(out)
