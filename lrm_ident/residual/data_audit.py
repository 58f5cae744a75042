"""Audit of the experiment design: confounding and missing excitation in a data set."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from lrm_ident.residual.thresholds import FEW_LEVELS, MOST_OF_RANGE, STRONG_CORRELATION
from lrm_math.arrays import Array
from lrm_math.effects.base import FEW_REVERSALS, Excitation
from lrm_math.kinematics.poses import Poses

UNLOADED = 0.05
"""Share of the largest torque up to which gravity does not load a joint: that of a vertical axis that leans by 3°."""


class LimitationKind(StrEnum):
    """What poses lack; the joints are those that lack it."""

    FEW_ANGLES = "few_angles"
    """Numbers: the fewest and the most different angles of such joints."""
    ORDER = "order_follows_joint"
    """Number: correlation of the joint's angle and the order."""
    NO_REVERSAL = "no_reversal"
    ONE_SIDED = "one_sided_torque"
    ONE_LOAD = "one_load"


@dataclass(frozen=True)
class Limitation:
    """Deficiency of poses. `joints`: from 1. See `LimitationKind`."""

    kind: LimitationKind
    joints: tuple[int, ...] = ()
    numbers: tuple[float, ...] = ()


@dataclass(frozen=True)
class MeasuredAngles:
    """Where a joint (from 1) was measured: its few `levels`, or the range from `least` to `most` (deg)."""

    joint: int
    levels: tuple[float, ...]
    least: float
    most: float


def audit(poses: Poses, torque: Array) -> tuple[Limitation, ...]:
    """Deficiencies of poses, measured or planned, the most severe first. `torque`: (N, n), N·m.

    What to measure instead is the matter of `design.advice`, which tries it.
    """
    excitation = Excitation(poses, torque)
    checks = (_levels, _order, _reversals, _signs, _loads)
    return tuple(limitation for check in checks for limitation in check(excitation))


def _levels(excitation: Excitation) -> Iterator[Limitation]:
    few = {i + 1: excitation.levels(i) for i in range(excitation.torque.shape[1]) if excitation.levels(i) <= FEW_LEVELS}
    if few:
        yield Limitation(LimitationKind.FEW_ANGLES, tuple(few), (min(few.values()), max(few.values())))


def _order(excitation: Excitation) -> Iterator[Limitation]:
    for joint, correlation in joints_of_order(excitation.poses.q).items():
        yield Limitation(LimitationKind.ORDER, (joint + 1,), (correlation,))


def where_it_holds(q: Array, lower: Array, upper: Array) -> tuple[MeasuredAngles, ...]:
    """Where a verdict of poses q (N, n) holds alone: at few levels of a joint, or in a part of its range (rad).

    Empty where every joint was measured at more levels than `FEW_LEVELS`, over most of its range.
    """
    parts = []
    for joint, angle in enumerate(np.degrees(q.T)):
        levels = np.unique(np.round(2.0 * angle) / 2.0)
        share = np.ptp(angle) / np.degrees(upper[joint] - lower[joint])
        few = len(levels) <= FEW_LEVELS
        if few or share < MOST_OF_RANGE:
            at = tuple(levels.tolist()) if few else ()
            parts.append(MeasuredAngles(joint + 1, at, float(angle.min()), float(angle.max())))
    return tuple(parts)


def joints_of_order(q: Array) -> dict[int, float]:
    """Joints from 0 that the order of poses q (N, n) follows, with the correlation of angle and order."""
    moved = {joint: angle for joint, angle in enumerate(q.T) if np.ptp(angle) > 0}
    correlations = {joint: float(np.corrcoef(np.arange(len(q)), angle)[0, 1]) for joint, angle in moved.items()}
    return {joint: correlation for joint, correlation in correlations.items() if abs(correlation) > STRONG_CORRELATION}


def _reversals(excitation: Excitation) -> Iterator[Limitation]:
    never = [i + 1 for i in range(excitation.torque.shape[1]) if excitation.reversals(i) < FEW_REVERSALS]
    if never and excitation.poses.direction is not None:
        yield Limitation(LimitationKind.NO_REVERSAL, tuple(never))


def _signs(excitation: Excitation) -> Iterator[Limitation]:
    size = np.abs(excitation.torque).max(axis=0)
    loaded = np.flatnonzero(size > UNLOADED * size.max()).tolist()
    same = [i + 1 for i in loaded if not excitation.both_signs(excitation.torque[:, i])]
    if same:
        yield Limitation(LimitationKind.ONE_SIDED, tuple(same))


def _loads(excitation: Excitation) -> Iterator[Limitation]:
    if len(np.unique(excitation.poses.payload)) == 1:
        yield Limitation(LimitationKind.ONE_LOAD)
