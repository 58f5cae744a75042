"""An arm in motion by an implementation of its own: coupled joints, stick and slip, a second mass on a spring.

Leapfrog of 1 ms over (C, 5) joints of C arms at once: (A + M(q)) q̈ = K sat(u − q) − D q̇ + g(q) − friction, with M and
g from the bodies of the independent chain, friction by Karnopp's (1985) band of zero speed. It shares no code with the
model that it tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
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

    @staticmethod
    def of(count: int) -> TrueJoints:
        """An arm of so many joints, in which nothing hides."""
        sound = TrueJoints()
        return TrueJoints(**{of.name: np.full(count, getattr(sound, of.name)[0]) for of in fields(TrueJoints)})


@dataclass(frozen=True)
class MovingWorld:
    """The bodies of an arm.

    Attributes:
        described: as the independent generator reads it. links_swing: what hangs on a spring is the link itself, with
            the inertia that each posture gives it, and the springs bear no weight; else a small mass that is read.
        gyration: m, of each body about its own centre.
    """

    described: ArmDescription
    links_swing: bool = False
    gyration: float = 0.0

    @cached_property
    def chain(self) -> TrueChain:
        """Rigid, as described."""
        return zero_configuration(self.described, GroundTruth.nominal(self.described))

    @cached_property
    def behind_springs(self) -> Array:
        """(n,), kg m², of the links about each joint, in the mean of postures within the limits."""
        low, high = np.array([link.limits_rad for link in self.described.links]).T
        postures = np.random.default_rng(0).uniform(low, high, (MANY_POSTURES, len(low)))
        return np.asarray(self.loads(postures, np.zeros_like(postures))[1].mean(axis=0).diagonal())

    def loads(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Torque of gravity, centrifugal and Coriolis forces (C, n), and the mass matrix (C, n, n) of the links.

        `q`, `v`: (C, n), angles and speeds. A centre of mass that the joints move by L q̇ has the acceleration
        L q̈ + L̇ q̇. The bodies' own turning counts in the mass matrix alone.
        """
        C, n = q.shape
        g, M = np.zeros((C, n)), np.zeros((C, n, n))
        gravity = np.array(self.described.gravity_m_per_s2)
        for (mass, lever, axes), (_, then, _), (_, before, _) in zip(
            self._levers(q), self._levers(q + SHORT_S * v), self._levers(q - SHORT_S * v), strict=True
        ):
            turning = np.einsum("cja,cj->ca", then - before, v) / (2.0 * SHORT_S)
            g += mass * np.einsum("cja,ca->cj", lever, gravity - turning)
            M += mass * (lever @ lever.transpose(0, 2, 1) + self.gyration**2 * axes @ axes.transpose(0, 2, 1))
        return g, M

    def _levers(self, q: Array) -> list[tuple[float, Array, Array]]:
        """Mass (kg) of each body, what its centre moves by for each rad of a joint (m), and the axes that turn it.

        Both are (C, n, 3).
        """
        posture, out = forward_kinematics(self.chain, np.zeros(len(q)), q, {}), []
        for number, body in enumerate(self.described.bodies):
            lever = np.cross(posture.joint_axes, posture.centres[:, number, None] - posture.joint_points)
            turned = (np.arange(q.shape[1]) < body.loads_joint)[None, :, None]
            carried = (np.arange(q.shape[1]) < body.frame)[None, :, None]
            out.append((body.mass_kg, lever * turned, posture.joint_axes * carried))
        return out


def described(name: str) -> ArmDescription:
    """An arm of the repository, as the independent generator reads it."""
    return load_arm(Path(__file__).resolve().parents[2] / "config" / "arms" / f"{name}.toml")


SO101 = MovingWorld(described("so101"))
ROVER = MovingWorld(described("lrm-rover"), links_swing=True, gyration=0.03)
SECOND_MASS = 0.02
"""Share of the second mass in the first."""
COGS = 60.0
"""Cogs to a turn of the joint."""
SLOWING_S = 60.0
MANY_POSTURES = 1000


def recorded(arms: list[TrueJoints], rng: np.random.Generator) -> list[Recording]:
    """A recording of each arm: episodes of teleoperation at 30 frames a second."""
    told = np.stack([np.stack([hand(rng) for _ in arms]) for _ in range(EPISODES)])  # (E, C, N, 5)
    return driven(arms, np.radians(encoder_readings(np.degrees(told), rng)), rng)


def driven(arms: list[TrueJoints], told: Array, rng: np.random.Generator) -> list[Recording]:
    """A recording of each arm that is told (E, C, N, 5), rad, in episodes, each from rest."""
    many, N = len(told), told.shape[2]
    begun = np.repeat(N / FPS * np.arange(many), len(arms))[:, None]
    ticks = round(1.0 / FPS / STEP_S)
    put_out = np.repeat(told.reshape(-1, *told.shape[2:]), ticks, axis=1)
    angle = followed(SO101, arms * many, put_out, begun, ticks, 1.0 / FPS / ticks).reshape(told.shape)
    angle = angle + np.stack([arm.offset for arm in arms])[:, None]
    read = encoder_readings(np.degrees(angle), rng)
    t, episode = np.tile(np.arange(N) / FPS, many), np.repeat(np.arange(many), N)
    return [
        Recording(np.degrees(told[:, c]).reshape(-1, JOINTS), read[:, c].reshape(-1, JOINTS), t, episode)
        for c in range(len(arms))
    ]


def hand(rng: np.random.Generator) -> Array:
    """(N, 5), rad: smooth moves, quick and slow ones, between stops; a slight tremor."""
    rows = tour(rng, JOINTS, FPS, EPISODE_S, (0.3, 1.3))
    tremor = np.convolve(rng.normal(size=len(rows)), np.ones(9) / 9.0, mode="same")
    return rows + 0.002 * tremor[:, None]


def tour(rng: np.random.Generator, joints: int, rate: float, seconds: float, rest_s: tuple[float, float]) -> Array:
    """(N, joints), rad, so many a second: smooth moves, quick and slow ones, between stops of so many seconds."""
    N, rows = int(rate * seconds), list[Array]()
    q = rng.uniform(-0.8, 0.8, joints)
    rows += [q] * 20
    while len(rows) < N:
        goal = np.where(rng.random(joints) < 0.25, q, rng.uniform(-0.9, 0.9, joints))
        s = np.linspace(0.0, 1.0, int(rate * np.exp(rng.uniform(np.log(0.35), np.log(2.0)))))[:, None]
        rows += list(q + (goal - q) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s))
        rows += [goal] * int(rate * rng.uniform(*rest_s))
        q = goal
    return np.array(rows[:N])


def followed(world: MovingWorld, arms: Sequence[TrueJoints], told: Array, begun: Array, ticks: int, h: float) -> Array:
    """(C, N, n), rad, where joints, or what hangs behind springs, are at the first of every `ticks` steps of h (s).

    told: (C, N ticks, n), put out at every step; begun: (C, 1), s since power-on.
    """
    p = {f.name: np.stack([getattr(arm, f.name) for arm in arms]) for f in fields(TrueJoints)}
    C, steps, n = told.shape
    K, omega = 1.0 / p["compliance"], 2.0 * np.pi * p["frequency_hz"]
    J0 = K / omega**2
    middle = world.loads(np.zeros((1, n)), np.zeros((1, n)))[1][0].diagonal()
    linked = p["link_share"] > 0.0
    K = np.where(linked, middle / np.maximum(p["link_share"], 1e-9) * omega**2, K)
    J0 = np.where(linked, K / omega**2, J0)
    A = np.where(linked, J0 - middle, J0 - middle)
    D = 2.0 * p["damping"] * omega * J0
    late, part = np.divmod(p["dead_time"] / h, 1.0)
    late = late.astype(int)
    c, j = np.arange(C)[:, None], np.arange(n)
    q, v, faster = told[:, 0].copy(), np.zeros((C, n)), np.zeros((C, n))
    u, du, profile = told[:, 0].copy(), np.zeros((C, n)), np.zeros((C, n))
    y, w, integral = q.copy(), np.zeros((C, n)), np.zeros((C, n))
    last_slip = np.zeros((C, n))
    shown, mean = q.copy(), u
    limited = p["acceleration"] < UNLIMITED
    led = limited | (p["speed"] < UNLIMITED)
    second = 2.0 * np.pi * p["second_hz"]
    sprung = second > 0.0
    mass2 = world.behind_springs if world.links_swing else SECOND_MASS * J0
    out = np.empty((C, -(-steps // ticks), n))
    for k in range(steps):
        if k % ticks == 0:
            out[:, k // ticks] = shown
        if k % LOADS_EVERY == 0:
            g, M = world.loads(q, v)
            J = M + A[:, :, None] * np.eye(n)
            braked = 0.5 * h * D[:, :, None] * np.eye(n)
            inverse, kept = np.linalg.inv(J + braked), J - braked
        goal = (1.0 - part) * told[c, np.maximum(k - late, 0), j] + part * told[c, np.maximum(k - late - 1, 0), j]
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
        push = torque if world.links_swing else torque - pull
        stuck = (np.abs(v) < STUCK_RAD_PER_S) & (np.abs(push) <= grip)
        net = push - np.sign(np.where(np.abs(v) < STUCK_RAD_PER_S, push, v)) * grip
        momentum = np.einsum("cij,cj->ci", kept, v) + h * np.where(stuck, 0.0, net)
        then = np.einsum("cij,cj->ci", inverse, momentum)
        turned = (grip > 0.0) & (then * v < 0.0) & (np.abs(push) <= grip)
        slower, v = v, np.where(stuck | turned, 0.0, then)
        q = q + h * v
        if world.links_swing:
            own = M[:, j, j]
            thrown = np.einsum("cij,cj->ci", M, v - slower) - own * (v - slower)
            w = w + np.where(sprung, (h * pull - thrown) / own, 0.0)
        else:
            w = w + h * np.where(sprung, pull / np.maximum(mass2, 1e-12), 0.0)
        y = np.where(sprung, y + h * w, q)
        shown = np.clip(shown, y - 0.5 * p["play"], y + 0.5 * p["play"])
    return out
