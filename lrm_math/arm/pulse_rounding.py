"""Rounding of commands to the whole pulse counts of the servo board.

At 50 Hz a count is half a degree, so rounding each joint by itself leaves millimetres. Of the 2ⁿ combinations of
the counts below and above, one is mostly several times nearer, since joints compensate each other.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from lrm_math.arm.arm import Arm, JointLimits
from lrm_math.arm.servo_table import PwmClock, ServoTable
from lrm_math.arrays import Vector3
from lrm_math.errors import LrmError

CHECKED = 4
"""Number of the combinations that are evaluated exactly, at most: the best by the sum of single joints' motions."""
CURVED = 1.1
"""Combinations whose error by that sum exceeds the best exact one by this factor are not evaluated."""


class Rounding(StrEnum):
    """Rounding rule."""

    EACH = "each"
    """Every joint to its nearest count."""
    BEST = "best"
    """The combination of neighbouring counts that comes nearest to the goal."""


@dataclass(frozen=True, slots=True)
class RoundedCommand:
    """A command in counts, their angles (rad), and the resulting distance from the goal (m)."""

    counts: tuple[int, ...]
    q: tuple[float, ...]
    error: float
    rounding: Rounding


@dataclass(frozen=True)
class ServoCounts:
    """Conversion between joint angles and counts: the servo tables of an arm and the clock of the board."""

    tables: tuple[ServoTable, ...]
    clock: PwmClock
    limits: JointLimits

    @classmethod
    def of(cls, arm: Arm, clock: PwmClock) -> ServoCounts:
        """Raises `LrmError` if a joint has no servo table."""
        tables = []
        for number, joint in enumerate(arm.joints, 1):
            if joint.servo is None:
                raise LrmError(f"joint {number} of arm {arm.name} has no servo table; counts need one for each joint")
            tables.append(joint.servo)
        return cls(tuple(tables), clock, JointLimits.of(arm))

    def neighbours(self, q: Sequence[float]) -> list[list[tuple[int, float]]]:
        """Counts of each joint below and above its command and their angles (rad), the nearer count first.

        Those beyond a limit are left out, unless there are no others.
        """
        out, count_s = [], self.clock.count_s
        for angle, table, low, high in zip(q, self.tables, self.limits.lower, self.limits.upper, strict=True):
            exact = float(table.pulse_of(angle)) / count_s
            below = math.floor(exact)
            nearer_first = (below, below + 1) if exact - below < 0.5 else (below + 1, below)
            both = [(count, float(table.angle_of(count * count_s))) for count in nearer_first]
            out.append([pair for pair in both if low <= pair[1] <= high] or both[:1])
        return out


def round_to_counts(
    servos: ServoCounts,
    q: tuple[float, ...],
    rounding: Rounding,
    position: Callable[[tuple[float, ...]], Sequence[float]],
    goal: Vector3,
) -> RoundedCommand:
    """The counts of a command. `position`: of the TCP (m) for commanded angles. `goal`: m.

    Of all combinations those are tried whose sum of single joints' motions comes nearest to the goal.
    """
    neighbours = servos.neighbours(q)

    def evaluated(choice: tuple[tuple[int, float], ...]) -> tuple[float, tuple[tuple[int, float], ...]]:
        return math.dist(position(tuple(angle for _, angle in choice)), goal), choice

    best = evaluated(tuple(pairs[0] for pairs in neighbours))
    if rounding is Rounding.BEST:
        every, here = list(itertools.product(*neighbours)), np.array(position(q))
        off = here[None] - goal
        for j, pairs in enumerate(neighbours):
            alone = np.array([position((*q[:j], angle, *q[j + 1 :])) for _, angle in pairs])
            off = (off[:, None] + (alone - here)).reshape(-1, 3)
        distance = np.linalg.norm(off, axis=1)
        for i in np.argsort(distance, kind="stable")[:CHECKED].tolist():
            if i > 0 and distance[i] < CURVED * best[0]:
                best = min(best, evaluated(every[i]), key=lambda pair: pair[0])
    error, choice = best
    return RoundedCommand(tuple(count for count, _ in choice), tuple(angle for _, angle in choice), error, rounding)
