"""Joint limits of an arm, and how far angles are from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError

AT_LIMIT = math.radians(1e-6)


@dataclass(frozen=True, slots=True)
class Violation:
    """The violated joint limit of the branch with the least excess: joint from 1, excess in rad."""

    joint: int
    excess: float

    def __str__(self) -> str:
        over = math.degrees(self.excess)
        return f"outside limits: joint {self.joint} would have to go {over:.2f} deg beyond its limit"


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Joint limits (rad), one number per joint."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @classmethod
    def of(cls, arm: Arm) -> JointLimits:
        """Limits of an arm's joints."""
        return cls(tuple(j.lower for j in arm.joints), tuple(j.upper for j in arm.joints))

    @property
    def middle(self) -> tuple[float, ...]:
        """Middle of every joint's range (rad)."""
        return tuple(0.5 * (a + b) for a, b in zip(self.lower, self.upper, strict=True))

    def margins(self, q: Sequence[float]) -> tuple[float, ...]:
        """Distance of every joint to its nearer limit (rad); negative beyond it."""
        return tuple(min(x - a, b - x) for x, a, b in zip(q, self.lower, self.upper, strict=True))

    def clipped(self, q: Sequence[float]) -> tuple[float, ...]:
        """Angles moved to the limits that they are beyond."""
        return tuple([min(max(x, a), b) for x, a, b in zip(q, self.lower, self.upper, strict=True)])

    def violation(self, q: Sequence[float]) -> Violation:
        """The limit with the largest excess."""
        margins = self.margins(q)
        worst = min(range(len(margins)), key=margins.__getitem__)
        return Violation(worst + 1, -margins[worst])


def feasible_approach(arm: Arm, q: Array, side: Array) -> Array:
    """Directions of approach (N, n) to angles q (N, n), rad, requested as `side` (N, n): at a limit from within."""
    limits = JointLimits.of(arm)
    from_above = np.where(q <= np.array(limits.lower) + AT_LIMIT, -1.0, side)
    return np.where(q >= np.array(limits.upper) - AT_LIMIT, 1.0, from_above)


def checked_angles(name: str, q: Sequence[float], dof: int) -> tuple[float, ...]:
    """(n,), rad. Raises `LrmError` unless they are n finite angles."""
    angles = tuple(float(x) for x in q)
    if len(angles) != dof or not all(map(math.isfinite, angles)):
        raise LrmError(f"{name} = {list(q)}; should be {dof} finite joint angles in rad")
    return angles
