"""Audit of the experiment design: confounding and missing excitation in a data set."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.base import FEW_REVERSALS, Excitation
from lrm_math.kinematics.poses import Poses

FEW_LEVELS, STRONG_CORRELATION = 4, 0.8
MOST_OF_RANGE = 2 / 3
"""Share of a joint's range from which a verdict speaks for the whole of it: a convention."""


def audit(poses: Poses, torque: Array) -> tuple[str, ...]:
    """Deficiencies of poses, measured or planned, one sentence each, the most severe first. `torque`: (N, n), N·m.

    What to measure instead is the matter of `design.advice`, which tries it.
    """
    excitation = Excitation(poses, torque)
    checks = (_levels, _order, _reversals, _signs, _loads)
    return tuple(sentence for check in checks for sentence in check(excitation))


def _levels(excitation: Excitation) -> Iterator[str]:
    few = {i + 1: excitation.levels(i) for i in range(excitation.torque.shape[1]) if excitation.levels(i) <= FEW_LEVELS}
    if few:
        least, most = min(few.values()), max(few.values())
        levels = f"{least}" if least == most else f"{least} to {most}"
        yield f"few angles: {levels} different ones at {_joints(few)}, so their errors look alike"


def _order(excitation: Excitation) -> Iterator[str]:
    for joint, correlation in joints_of_order(excitation.poses.q).items():
        yield f"order: follows joint {joint + 1} (correlation {correlation:.2f}), as drift would"


def where_it_holds(q: Array, lower: Array, upper: Array) -> str:
    """Sentence on where a verdict of poses q (N, n) holds: at few levels of a joint, or in a part of its range (rad).

    Empty where every joint was measured at more levels than `FEW_LEVELS`, over most of its range.
    """
    parts = []
    for joint, angle in enumerate(np.degrees(q.T)):
        levels = np.unique(np.round(2.0 * angle) / 2.0)
        share = np.ptp(angle) / np.degrees(upper[joint] - lower[joint])
        if len(levels) <= FEW_LEVELS:
            parts.append(f"joint {joint + 1} at {', '.join(f'{level:g}' for level in levels)} deg only")
        elif share < MOST_OF_RANGE:
            parts.append(f"joint {joint + 1} from {angle.min():.0f} to {angle.max():.0f} deg")
    return f"only where it was measured: {'; '.join(parts)}" if parts else ""


def joints_of_order(q: Array) -> dict[int, float]:
    """Joints from 0 that the order of poses q (N, n) follows, with the correlation of angle and order."""
    moved = {joint: angle for joint, angle in enumerate(q.T) if np.ptp(angle) > 0}
    found = {joint: float(np.corrcoef(np.arange(len(q)), angle)[0, 1]) for joint, angle in moved.items()}
    return {joint: correlation for joint, correlation in found.items() if abs(correlation) > STRONG_CORRELATION}


def _reversals(excitation: Excitation) -> Iterator[str]:
    never = [i + 1 for i in range(excitation.torque.shape[1]) if excitation.reversals(i) < FEW_REVERSALS]
    if never and excitation.poses.direction is not None:
        yield f"no reversal: {_joints(never)} came from one side, so friction cannot show"


def _signs(excitation: Excitation) -> Iterator[str]:
    same = [i + 1 for i, tau in enumerate(excitation.torque.T) if not excitation.both_signs(tau)]
    if same:
        yield f"one-sided torque: gravity loads {_joints(same)} to one side, so backlash cannot show there"


def _loads(excitation: Excitation) -> Iterator[str]:
    if len(np.unique(excitation.poses.payload)) == 1:
        yield "one load: stiffness, backlash and mass look alike"


def _joints(numbers: Iterable[int]) -> str:
    names = list(map(str, numbers))
    if len(names) > 2 and len(names) == int(names[-1]) - int(names[0]) + 1:
        return f"joints {names[0]} to {names[-1]}"
    return f"joint {names[0]}" if len(names) == 1 else f"joints {', '.join(names[:-1])} and {names[-1]}"
