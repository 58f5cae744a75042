"""An arm in motion by an implementation of its own: coupled joints, stick and slip, a second mass on a spring.

Leapfrog of 1 ms over (C, 5) joints of C arms at once: (A + M(q)) q̈ = K sat(u − q) − D q̇ + g(q) − friction, with M and
g from the bodies of the independent chain, friction by Karnopp's (1985) band of zero speed. It shares no code with the
model that it tests.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path

import numpy as np

from validation.lerobot_dataset import FPS, Recording, encoder_readings
from validation.synthetic import ArmDescription, GroundTruth, load_arm
from validation.synthetic.chain import TrueChain, forward_kinematics, zero_configuration
from validation.synthetic.screws import Array

JOINTS, EPISODES, EPISODE_S = 5, 4, 24.0
STEP_S, LOADS_EVERY = 0.001, 10
STUCK_RAD_PER_S, SHORT_S = 0.002, 1e-4
STIFF_NM_PER_RAD = 400000.0
"""Of a joint that hardly notices gravity and the others: what is not hidden is not there."""
UNLIMITED = 1e9


def _all(value: float) -> Array:
    return np.full(JOINTS, value)


@dataclass
class TrueJoints:
    """What hides in the joints of one arm, (5,) each, in rad, s, N·m, kg m²; the defaults hide nothing.

    `compliance`: of the servo, 1/K. `link_share`: of J in the middle posture that is the links'. `friction`,
    `load_friction`, `stiction`: over K; the last fades with `stiction_speed`. `second_*`: mass on a spring behind the
    servo, which the encoder sits on.
    """

    frequency_hz: Array = field(default_factory=lambda: _all(4.0))
    damping: Array = field(default_factory=lambda: _all(0.8))
    offset: Array = field(default_factory=lambda: _all(0.0))
    compliance: Array = field(default_factory=lambda: _all(1.0 / STIFF_NM_PER_RAD))
    link_share: Array = field(default_factory=lambda: _all(0.0))
    dead_time: Array = field(default_factory=lambda: _all(0.0))
    speed: Array = field(default_factory=lambda: _all(UNLIMITED))
    acceleration: Array = field(default_factory=lambda: _all(UNLIMITED))
    drive: Array = field(default_factory=lambda: _all(UNLIMITED))
    lead: Array = field(default_factory=lambda: _all(0.0))
    friction: Array = field(default_factory=lambda: _all(0.0))
    load_friction: Array = field(default_factory=lambda: _all(0.0))
    stiction: Array = field(default_factory=lambda: _all(0.0))
    stiction_speed: Array = field(default_factory=lambda: _all(0.1))
    play: Array = field(default_factory=lambda: _all(0.0))
    second_hz: Array = field(default_factory=lambda: _all(0.0))
    second_damping: Array = field(default_factory=lambda: _all(0.05))
    integral_s: Array = field(default_factory=lambda: _all(np.inf))
    cogging: Array = field(default_factory=lambda: _all(0.0))
    drag: Array = field(default_factory=lambda: _all(0.0))
    slowing: Array = field(default_factory=lambda: _all(0.0))


SECOND_MASS = 0.02
"""Share of the second mass in the first."""
COGS = 60.0
"""Cogs to a turn of the joint."""
SLOWING_S = 60.0


def recorded(arms: list[TrueJoints], rng: np.random.Generator) -> list[Recording]:
    """A recording of each arm: episodes of teleoperation at 30 frames a second."""
    told = np.stack([np.stack([hand(rng) for _ in arms]) for _ in range(EPISODES)])  # (E, C, N, 5)
    return driven(arms, np.radians(encoder_readings(np.degrees(told), rng)), rng)


def driven(arms: list[TrueJoints], told: Array, rng: np.random.Generator) -> list[Recording]:
    """A recording of each arm that is told (E, C, N, 5), rad, in episodes, each from rest."""
    many, N = len(told), told.shape[2]
    begun = np.repeat(N / FPS * np.arange(many), len(arms))[:, None]
    angle = _followed(arms * many, told.reshape(-1, *told.shape[2:]), begun).reshape(told.shape)
    angle = angle + np.stack([arm.offset for arm in arms])[:, None]
    read = encoder_readings(np.degrees(angle), rng)
    t, episode = np.tile(np.arange(N) / FPS, many), np.repeat(np.arange(many), N)
    return [
        Recording(np.degrees(told[:, c]).reshape(-1, JOINTS), read[:, c].reshape(-1, JOINTS), t, episode)
        for c in range(len(arms))
    ]


def hand(rng: np.random.Generator) -> Array:
    """(N, 5), rad: smooth moves, quick and slow ones, between stops; a slight tremor."""
    N, rows = int(FPS * EPISODE_S), list[Array]()
    q = rng.uniform(-0.8, 0.8, JOINTS)
    rows += [q] * 20
    while len(rows) < N:
        goal = np.where(rng.random(JOINTS) < 0.25, q, rng.uniform(-0.9, 0.9, JOINTS))
        s = np.linspace(0.0, 1.0, int(FPS * np.exp(rng.uniform(np.log(0.35), np.log(2.0)))))[:, None]
        rows += list(q + (goal - q) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s))
        rows += [goal] * int(FPS * rng.uniform(0.3, 1.3))
        q = goal
    tremor = np.convolve(rng.normal(size=N), np.ones(9) / 9.0, mode="same")
    return np.array(rows[:N]) + 0.002 * tremor[:, None]


def _followed(arms: list[TrueJoints], told: Array, begun: Array) -> Array:
    """(C, N, 5), rad, what the encoders sit at in each frame; told: (C, N, 5); begun: (C, 1), s since power-on."""
    p = {f.name: np.stack([getattr(arm, f.name) for arm in arms]) for f in fields(TrueJoints)}
    C, N, _ = told.shape
    ticks = round(1.0 / FPS / STEP_S)
    h = 1.0 / FPS / ticks
    K, omega = 1.0 / p["compliance"], 2.0 * np.pi * p["frequency_hz"]
    J0 = K / omega**2
    middle = _loads(np.zeros((1, JOINTS)), np.zeros((1, JOINTS)))[1][0].diagonal()
    linked = p["link_share"] > 0.0
    K = np.where(linked, middle / np.maximum(p["link_share"], 1e-9) * omega**2, K)
    J0 = np.where(linked, K / omega**2, J0)
    A = np.where(linked, J0 - middle, J0 - middle)
    D = 2.0 * p["damping"] * omega * J0
    late, part = np.divmod(p["dead_time"] / h, 1.0)
    late = late.astype(int)
    history = np.repeat(told, ticks, axis=1)
    c, j = np.arange(C)[:, None], np.arange(JOINTS)
    q, v = told[:, 0].copy(), np.zeros((C, JOINTS))
    u, du, profile = told[:, 0].copy(), np.zeros((C, JOINTS)), np.zeros((C, JOINTS))
    y, w, integral = q.copy(), np.zeros((C, JOINTS)), np.zeros((C, JOINTS))
    last_slip = np.zeros((C, JOINTS))
    shown, mean = q.copy(), u
    limited = p["acceleration"] < UNLIMITED
    led = limited | (p["speed"] < UNLIMITED)
    second = 2.0 * np.pi * p["second_hz"]
    sprung = second > 0.0
    mass2 = SECOND_MASS * J0
    out = np.empty((C, N, JOINTS))
    for k in range(N * ticks):
        if k % ticks == 0:
            out[:, k // ticks] = shown
        if k % LOADS_EVERY == 0:
            g, M = _loads(q, v)
            J = M + A[:, :, None] * np.eye(JOINTS)
            braked = 0.5 * h * D[:, :, None] * np.eye(JOINTS)
            inverse, kept = np.linalg.inv(J + braked), J - braked
        goal = (1.0 - part) * history[c, np.maximum(k - late, 0), j] + part * history[c, np.maximum(k - late - 1, 0), j]
        ahead = goal - u
        half = 0.5 * p["acceleration"] * h
        braked_in_time = np.sqrt(
            np.maximum(half**2 + 4.0 * half * (np.abs(ahead) / h - 0.5 * np.sign(ahead) * profile), 0.0)
        )
        wanted = np.sign(ahead) * np.where(limited, braked_in_time - half, np.abs(ahead) / h)
        wanted = np.clip(wanted, -p["speed"], p["speed"])
        faster = profile + np.clip(wanted - profile, -2.0 * half, 2.0 * half)
        before, u = u, u + h * np.where(limited, 0.5 * (profile + faster), faster)
        profile = faster
        du = (u - before) / h
        slow = 1.0 + p["slowing"] * (1.0 - np.exp(-(begun + k * h) / SLOWING_S))
        earlier, mean = (
            mean,
            np.where(led, 0.5 * (before + u), u),
        )  # over the step; a leapfrog's force is at its beginning
        error = 0.5 * (earlier + mean) + p["lead"] * du - q
        integral = integral + h * error / p["integral_s"]
        torque = K / slow * np.clip(error + integral, -p["drive"], p["drive"]) + g
        torque = torque + K * p["cogging"] * np.sin(COGS * q) - K * p["drag"] * v * np.abs(v)
        slip, last_slip = 1.5 * (v - w) - 0.5 * last_slip, v - w  # speeds are half a step behind angles
        pull = np.where(sprung, mass2 * (second**2 * (q - y) + 2.0 * p["second_damping"] * second * slip), 0.0)
        rub = K * (p["friction"] + p["load_friction"] * np.abs(g))
        grip = rub + K * p["stiction"] * np.exp(-((v / p["stiction_speed"]) ** 2))
        push = torque - pull
        stuck = (np.abs(v) < STUCK_RAD_PER_S) & (np.abs(push) <= grip)
        net = push - np.sign(np.where(np.abs(v) < STUCK_RAD_PER_S, push, v)) * grip
        momentum = np.einsum("cij,cj->ci", kept, v) + h * np.where(stuck, 0.0, net)
        then = np.einsum("cij,cj->ci", inverse, momentum)
        turned = (grip > 0.0) & (then * v < 0.0) & (np.abs(push) <= grip)
        v = np.where(stuck | turned, 0.0, then)
        q = q + h * v
        w = w + h * np.where(sprung, pull / np.maximum(mass2, 1e-12), 0.0)
        y = np.where(sprung, y + h * w, q)
        shown = np.clip(shown, y - 0.5 * p["play"], y + 0.5 * p["play"])
    return out


def _loads(q: Array, v: Array) -> tuple[Array, Array]:
    """Torque of gravity, centrifugal and Coriolis forces (C, 5), and the mass matrix (C, 5, 5) of the links.

    `q`, `v`: (C, 5), angles and speeds. A centre of mass that the joints move by L q̇ has the acceleration L q̈ + L̇ q̇.
    """
    g, M = np.zeros((len(q), JOINTS)), np.zeros((len(q), JOINTS, JOINTS))
    gravity = np.array(_described()[0].gravity_m_per_s2)
    for (mass, lever), (_, then), (_, before) in zip(
        _levers(q), _levers(q + SHORT_S * v), _levers(q - SHORT_S * v), strict=True
    ):
        turning = np.einsum("cja,cj->ca", then - before, v) / (2.0 * SHORT_S)
        g += mass * np.einsum("cja,ca->cj", lever, gravity - turning)
        M += mass * lever @ lever.transpose(0, 2, 1)
    return g, M


def _levers(q: Array) -> list[tuple[float, Array]]:
    """Mass (kg) of each body, and what its centre moves by for each rad of a joint, (C, 5, 3), m."""
    arm, chain = _described()
    posture, out = forward_kinematics(chain, np.zeros(len(q)), q, {}), []
    for number, body in enumerate(arm.bodies):
        lever = np.cross(posture.joint_axes, posture.centres[:, number, None] - posture.joint_points)
        out.append((body.mass_kg, lever * (np.arange(JOINTS) < body.loads_joint)[None, :, None]))
    return out


@cache
def described_so101() -> ArmDescription:
    """As the independent generator reads it."""
    return load_arm(Path(__file__).resolve().parents[2] / "config" / "arms" / "so101.toml")


@cache
def _described() -> tuple[ArmDescription, TrueChain]:
    arm = described_so101()
    return arm, zero_configuration(arm, GroundTruth.nominal(arm))
