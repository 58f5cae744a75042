"""Pulses are whole counts: what that leaves of an answer, and which of the neighbouring counts leave least.

At 50 Hz a count is half a degree, so rounding each joint by itself leaves millimetres. Joints can make up for each
other: of the 2ⁿ choices of the count below or above, one is mostly several times nearer.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arm.servo_table import PwmClock, ServoTable
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.answer import Limits

CHECKED = 4
"""How many of the linearly best combinations are reckoned exactly, at most."""
CURVED = 1.1
"""Those are not that are linearly this much worse than the best one is exactly: half degrees hardly bend the way."""


class Rounding(StrEnum):
    """How commands become counts."""

    EACH = "each"
    """Every joint to its nearest count."""
    BEST = "best"
    """The combination of neighbouring counts that comes nearest to the goal."""


@dataclass(frozen=True, slots=True)
class Rounded:
    """What a servo board makes of a command: counts, the angles (rad) that these are, and how far off the goal (m)."""

    counts: tuple[int, ...]
    q: tuple[float, ...]
    error: float
    rounding: Rounding


@dataclass(frozen=True)
class Servos:
    """The servos of an arm on a board with a clock."""

    tables: tuple[ServoTable, ...]
    clock: PwmClock
    limits: Limits

    @classmethod
    def of(cls, arm: Arm, clock: PwmClock) -> Servos:
        """Raises `LrmError` if a joint has no servo table."""
        tables = []
        for number, joint in enumerate(arm.joints, 1):
            if joint.servo is None:
                raise LrmError(f"joint {number} of arm {arm.name} has no servo table; counts need one for each joint")
            tables.append(joint.servo)
        return cls(tuple(tables), clock, Limits.of(arm))

    def neighbours(self, q: Sequence[float]) -> list[list[tuple[int, float]]]:
        """For each joint the counts below and above its command and their angles (rad), the nearer count first.

        Those beyond a limit are left out, unless there are no others.
        """
        out = []
        for angle, table, low, high in zip(q, self.tables, self.limits.lower, self.limits.upper, strict=True):
            exact = float(table.pulse_of(angle)) / self.clock.count_s
            below = math.floor(exact)
            nearer_first = (below, below + 1) if exact - below < 0.5 else (below + 1, below)
            both = [(count, float(table.angle_of(self.clock.pulse_of(count)))) for count in nearer_first]
            out.append([pair for pair in both if low <= pair[1] <= high] or both[:1])
        return out


def rounded(
    servos: Servos,
    q: Sequence[float],
    rounding: Rounding,
    miss: Callable[[tuple[float, ...]], float],
    jacobian: Callable[[], Array],
) -> Rounded:
    """The counts of a command.

    Args:
        miss: distance of the TCP from the goal (m) for angles that the board puts out.
        jacobian: (3, n), how the TCP answers commands (m/rad); asked for only where combinations are compared.
    """
    neighbours = servos.neighbours(q)

    def reckoned(choice: tuple[tuple[int, float], ...]) -> tuple[float, tuple[tuple[int, float], ...]]:
        return miss(tuple(angle for _, angle in choice)), choice

    best = reckoned(tuple(pairs[0] for pairs in neighbours))
    if rounding is Rounding.BEST:
        every = list(itertools.product(*neighbours))
        off = np.array([[angle for _, angle in choice] for choice in every]) - np.asarray(q)
        distance = np.sqrt(((off @ jacobian().T) ** 2).sum(axis=1))
        for i in np.argsort(distance, kind="stable")[:CHECKED].tolist():
            if i > 0 and distance[i] < CURVED * best[0]:
                best = min(best, reckoned(every[i]), key=lambda pair: pair[0])
    error, choice = best
    return Rounded(tuple(count for count, _ in choice), tuple(angle for _, angle in choice), error, rounding)
