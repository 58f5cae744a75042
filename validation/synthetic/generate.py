"""Synthetic measurements: random poses, true states, systematic and random measurement errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .arm_description import ArmDescription
from .chain import forward_kinematics, zero_configuration
from .ground_truth import GroundTruth
from .hidden_effect import CommandedPoses
from .screws import Array
from .statics import TrueState, equilibrium


@dataclass(frozen=True)
class Schedule:
    """Times of P measured poses: time_s (P,), session (P,) from 1, and the start pose (N,) in rad."""

    time_s: Array
    session: Array
    start_q_rad: Array


@dataclass(frozen=True)
class Dataset:
    """Measurements of a true arm: q_rad (P, N), payload_kg (P,), tcp_m (P, 3) in world axes."""

    arm: ArmDescription
    truth: GroundTruth
    schedule: Schedule
    q_rad: Array
    payload_kg: Array
    tcp_m: Array
    noise_sd_m: float
    seed: int


def even_schedule(poses: int, joints: int) -> Schedule:
    """One session from the home pose, a measurement every 15 s."""
    return Schedule(15.0 * np.arange(1, poses + 1, dtype=float), np.ones(poses), np.zeros(joints))


def random_poses(
    arm: ArmDescription, count: int, seed: int, limit_deg: float | None = None, floor_m: float = 0.02, tries: int = 50
) -> Array:
    """Joint angles (count, N) in rad, uniform within the limits and rounded to 0.01 deg.

    Poses whose nominal TCP is not above floor_m are redrawn (rejection sampling); those left after `tries` are kept.
    """
    rng = np.random.default_rng(seed)
    bound = math.inf if limit_deg is None else math.radians(limit_deg)
    low = np.array([max(link.limits_rad[0], -bound) for link in arm.links])
    high = np.array([min(link.limits_rad[1], bound) for link in arm.links])
    q = _draw(rng, low, high, count)
    for _ in range(tries):
        low_poses = nominal_tip(arm, q)[:, 2] <= floor_m
        if not low_poses.any():
            break
        q[low_poses] = _draw(rng, low, high, int(low_poses.sum()))
    return q


def nominal_tip(arm: ArmDescription, q_rad: Array) -> Array:
    """Positions (P, 3) in m of the TCP of the rigid arm as described, at joint angles (P, N)."""
    chain = zero_configuration(arm, GroundTruth.nominal(arm))
    return forward_kinematics(chain, np.zeros(len(q_rad)), q_rad, {}).tcp


def _draw(rng: np.random.Generator, low: Array, high: Array, count: int) -> Array:
    return rounded(rng.uniform(low, high, size=(count, len(low))))


def rounded(q_rad: Array) -> Array:
    """Joint angles rounded to 0.01 deg, as in the file."""
    return np.deg2rad(np.round(np.rad2deg(q_rad), 2))


def true_state(
    arm: ArmDescription, truth: GroundTruth, q: ArrayLike, payload_kg: ArrayLike = 0.0, schedule: Schedule | None = None
) -> TrueState:
    """Equilibrium at the commanded angles q (P, N) in rad with payload_kg (P,) or one for all; no measurement error."""
    return equilibrium(arm, truth, _commanded(arm, q, payload_kg, schedule))


def rigid_torque(poses: CommandedPoses, joint: int) -> Array:
    """Torque (P,) about a joint of the arm as described: what a pose does to later ones must not depend on these."""
    state = true_state(poses.arm, GroundTruth.nominal(poses.arm), poses.q_rad, poses.payload_kg)
    return state.tau_nm[:, joint - 1]


def measure(
    arm: ArmDescription,
    truth: GroundTruth,
    q: ArrayLike,
    payload_kg: ArrayLike = 0.0,
    noise_m: float = 0.0,
    seed: int = 0,
    schedule: Schedule | None = None,
) -> Array:
    """Measured TCP (P, 3) in m, with normal noise of noise_m per axis."""
    poses = _commanded(arm, q, payload_kg, schedule)
    tcp = equilibrium(arm, truth, poses).tcp_m
    measured = tcp + sum((effect.measurement_error(tcp) for effect in truth.effects), np.zeros(3))
    return np.asarray(measured + noise_m * np.random.default_rng(seed).normal(size=tcp.shape))


def simulate(
    arm: ArmDescription,
    truth: GroundTruth,
    q: ArrayLike,
    payload_kg: ArrayLike = 0.0,
    noise_m: float = 0.0003,
    seed: int = 0,
    schedule: Schedule | None = None,
) -> Dataset:
    """A data set of the arm at the angles q (P, N), rounded as in the file before the arm moves to them."""
    angles = rounded(np.asarray(q, dtype=float))
    schedule = schedule or even_schedule(*angles.shape)
    payload = np.broadcast_to(np.asarray(payload_kg, dtype=float), len(angles)).copy()
    tcp = measure(arm, truth, angles, payload, noise_m, seed, schedule)
    return Dataset(arm, truth, schedule, angles, payload, tcp, noise_m, seed)


def _commanded(arm: ArmDescription, q: ArrayLike, payload_kg: ArrayLike, schedule: Schedule | None) -> CommandedPoses:
    angles = np.asarray(q, dtype=float)
    schedule = schedule or even_schedule(*angles.shape)
    payload = np.broadcast_to(np.asarray(payload_kg, dtype=float), len(angles))
    return CommandedPoses(
        arm, angles, directions(angles, schedule.start_q_rad), schedule.time_s, schedule.session, payload
    )


def directions(q_rad: Array, start_q_rad: Array) -> Array:
    """Sign (P, N) of each joint's last nonzero move; zero before its first."""
    signs = np.sign(np.diff(q_rad, axis=0, prepend=start_q_rad[None]))
    for row in range(1, len(signs)):
        still = signs[row] == 0.0
        signs[row, still] = signs[row - 1, still]
    return signs
