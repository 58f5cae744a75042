"""Two arms in teleoperation: a hand that leads, servos that follow, encoders of 4096 steps that flicker."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_math.arrays import Array
from validation.lerobot_dataset import FPS, Recording, encoder_readings
from validation.motion.world import SO101
from validation.synthetic import GroundTruth, true_state

EPISODES, STOPS = 5, 16
JOINTS = 5
TREMOR_DEG, LAG_S = 0.05, 0.08
CAUSES = ("droop", "dead band", "offset", "drift", "slip")


@dataclass(frozen=True)
class FollowingArm:
    """Follower of a leader, by joint: `droop` (deg/N·m), `band` (deg, from side to side), `offset` (deg), `warming`
    (deg in the end), `slip` (deg, from time `slipped_s` on)."""

    droop: Array
    band: Array
    offset: Array
    warming: Array
    warming_s: float
    slip: Array
    slipped_s: float


def sound_arm(rng: np.random.Generator) -> FollowingArm:
    """Servos as they are: each of the causes is there, too small to matter."""

    def small(most: float) -> Array:
        return rng.uniform(-most, most, JOINTS)

    none = np.zeros(JOINTS)
    droop, band = np.abs(small(0.25)), 0.05 + np.abs(small(0.15))
    return FollowingArm(droop, band, small(0.1), small(0.1), float(rng.uniform(60, 300)), none, np.inf)


def ailing_arm(cause: str, rng: np.random.Generator, offset_deg: float | None = None) -> tuple[FollowingArm, int]:
    """A sound arm but for one cause at one joint, and that joint, from 0."""
    sound = sound_arm(rng)
    joint = int(rng.integers(1, 4)) if cause == "droop" else int(rng.integers(0, JOINTS))
    size, sign = float(rng.uniform(1.0, 2.0)), float(rng.choice([-1.0, 1.0]))

    def at(values: Array, value: float) -> Array:
        out = values.copy()
        out[joint] = value
        return out

    ailing = {
        "droop": replace(sound, droop=at(sound.droop, 2.0 * size * (2.0 if joint == 3 else 1.0))),
        "dead band": replace(sound, band=at(sound.band, size)),
        "offset": replace(sound, offset=at(sound.offset, sign * (offset_deg or 2.0 * size))),
        "drift": replace(sound, warming=at(sound.warming, sign * size)),
        "slip": replace(sound, slip=at(sound.slip, sign * size), slipped_s=float(rng.uniform(60.0, 130.0))),
    }
    return ailing[cause], joint


def recorded(arm: FollowingArm, rng: np.random.Generator) -> Recording:
    """Episodes of moves and stops."""
    begun, parts = 0.0, []
    for episode in range(EPISODES):
        lead = _hand(rng)
        state = _followed(arm, lead, begun, rng)
        action = encoder_readings(lead, rng)
        t = np.arange(len(lead)) / FPS
        parts.append((action, state, t, np.full(len(t), episode)))
        begun += t[-1]
    return Recording(*(np.concatenate([part[k] for part in parts]) for k in range(4)))


def _hand(rng: np.random.Generator) -> Array:
    """(N, 5), deg: smooth moves between stops, some joints staying, a slight tremor."""
    q, rows = rng.uniform(-50.0, 50.0, JOINTS), []
    for _ in range(STOPS):
        goal = np.where(rng.random(JOINTS) < 0.25, q, rng.uniform(-50.0, 50.0, JOINTS))
        share = np.linspace(0.0, 1.0, int(FPS * rng.uniform(0.7, 1.5)))
        rows += [q + (goal - q) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s) for s in share]
        rows += [goal] * int(FPS * rng.uniform(0.8, 1.8))
        q = goal
    smooth = np.convolve(rng.normal(size=len(rows)), np.ones(9) / 9.0, mode="same")
    return np.array(rows) + TREMOR_DEG * 3.0 * smooth[:, None]


def _followed(arm: FollowingArm, lead: Array, begun: float, rng: np.random.Generator) -> Array:
    """(N, 5), deg, what the follower's encoders read."""
    shaft, out = lead[0].copy(), []
    torque = _torque(lead)
    for row, command in enumerate(lead):
        now = begun + row / FPS
        due = command + arm.droop * torque[row] + arm.offset + arm.warming * (1.0 - np.exp(-now / arm.warming_s))
        due = due + arm.slip * (now >= arm.slipped_s)
        towards = np.clip(shaft, due - 0.5 * arm.band, due + 0.5 * arm.band)  # it stops as soon as it is within
        shaft = shaft + (towards - shaft) * (1.0 - np.exp(-1.0 / FPS / LAG_S))
        out.append(shaft)
    return encoder_readings(np.array(out), rng)


def _torque(q_deg: Array) -> Array:
    """(N, 5), N·m, gravity's on the joints: every fifth frame by the independent generator, straight between."""
    arm = SO101.described
    rows = np.unique(np.r_[np.arange(0, len(q_deg), 5), len(q_deg) - 1])
    tau = true_state(arm, GroundTruth.nominal(arm), np.radians(q_deg[rows])).tau_nm
    return np.stack([np.interp(np.arange(len(q_deg)), rows, column) for column in tau.T], axis=1)
