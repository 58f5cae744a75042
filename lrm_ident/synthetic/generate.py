"""Synthetic measurements: poses, true states, noise."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .chain import move, zero_configuration
from .hidden import Sight, Situation
from .rig import Rig
from .screws import Array
from .statics import TrueState, equilibrium
from .truth import Truth

STEP_S = 15.0


@dataclass(frozen=True)
class Schedule:
    """When P poses are measured: time_s (P,) and session (P,) (from 1), and the pose (N,) that the arm starts from."""

    time_s: Array
    session: Array
    start_q_rad: Array


@dataclass(frozen=True)
class Dataset:
    """What was measured on a true arm: q_rad (P, N), payload_kg (P,), tcp_m (P, 3) in world axes."""

    rig: Rig
    truth: Truth
    schedule: Schedule
    q_rad: Array
    payload_kg: Array
    tcp_m: Array
    noise_sd_m: float
    seed: int


def even_schedule(poses: int, joints: int) -> Schedule:
    """One session from the home pose, a measurement every 15 s."""
    return Schedule(STEP_S * np.arange(1, poses + 1, dtype=float), np.ones(poses), np.zeros(joints))


def poses(
    rig: Rig, count: int, seed: int, limit_deg: float | None = None, floor_m: float = 0.02, tries: int = 50
) -> Array:
    """Joint angles (count, N) in rad, uniform within the limits and rounded to 0.01 deg.

    The TCP of the nominal rigid arm stands above floor_m; poses that still fail after many tries are kept.
    """
    rng = np.random.default_rng(seed)
    bound = math.inf if limit_deg is None else math.radians(limit_deg)
    low = np.array([max(link.limits_rad[0], -bound) for link in rig.links])
    high = np.array([min(link.limits_rad[1], bound) for link in rig.links])
    q = _draw(rng, low, high, count)
    chain = zero_configuration(rig, Truth.nominal(rig))
    for _ in range(tries):
        under = move(chain, np.zeros(count), q, {}).tcp[:, 2] <= floor_m
        if not under.any():
            break
        q[under] = _draw(rng, low, high, int(under.sum()))
    return q


def _draw(rng: np.random.Generator, low: Array, high: Array, count: int) -> Array:
    return rounded(rng.uniform(low, high, size=(count, len(low))))


def rounded(q_rad: Array) -> Array:
    """Joint angles as a file holds them: to 0.01 deg."""
    return np.deg2rad(np.round(np.rad2deg(q_rad), 2))


def true_state(
    rig: Rig, truth: Truth, q: ArrayLike, payload_kg: ArrayLike = 0.0, schedule: Schedule | None = None
) -> TrueState:
    """Equilibrium at the commanded angles q (P, N) in rad with payload_kg (P,) or one for all; no noise, no tracker."""
    return equilibrium(rig, truth, _situation(rig, q, payload_kg, schedule))


def measure(
    rig: Rig,
    truth: Truth,
    q: ArrayLike,
    payload_kg: ArrayLike = 0.0,
    noise_m: float = 0.0,
    seed: int = 0,
    schedule: Schedule | None = None,
) -> Array:
    """TCP (P, 3) in m as the tracker sees it, with normal noise of noise_m per axis."""
    now = _situation(rig, q, payload_kg, schedule)
    sight = Sight(now, equilibrium(rig, truth, now).tcp_m)
    seen = sight.tcp_m + sum((effect.seen_shift(sight) for effect in truth.effects), np.zeros(3))
    return np.asarray(seen + noise_m * np.random.default_rng(seed).normal(size=seen.shape))


def simulate(
    rig: Rig,
    truth: Truth,
    q: ArrayLike,
    payload_kg: ArrayLike = 0.0,
    noise_m: float = 0.0003,
    seed: int = 0,
    schedule: Schedule | None = None,
) -> Dataset:
    """A data set as it can be written: the angles are rounded before the arm moves to them."""
    angles = rounded(np.asarray(q, dtype=float))
    plan = schedule or even_schedule(*angles.shape)
    payload = np.broadcast_to(np.asarray(payload_kg, dtype=float), len(angles)).copy()
    tcp = measure(rig, truth, angles, payload, noise_m, seed, plan)
    return Dataset(rig, truth, plan, angles, payload, tcp, noise_m, seed)


def _situation(rig: Rig, q: ArrayLike, payload_kg: ArrayLike, schedule: Schedule | None) -> Situation:
    angles = np.asarray(q, dtype=float)
    plan = schedule or even_schedule(*angles.shape)
    payload = np.broadcast_to(np.asarray(payload_kg, dtype=float), len(angles))
    return Situation(rig, angles, directions(angles, plan.start_q_rad), plan.time_s, plan.session, payload)


def directions(q_rad: Array, start_q_rad: Array) -> Array:
    """Sign (P, N) of each joint's last move that was one; zero before its first."""
    signs = np.sign(np.diff(q_rad, axis=0, prepend=start_q_rad[None]))
    for row in range(1, len(signs)):
        still = signs[row] == 0.0
        signs[row, still] = signs[row - 1, still]
    return signs
