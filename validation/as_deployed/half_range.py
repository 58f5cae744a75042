"""Half of a joint's range, to which the poses of a case are held."""

from __future__ import annotations

from dataclasses import dataclass, replace

from lrm_math.arrays import Array
from validation.hidden_effects.case import Case
from validation.hidden_effects.data import drawn_poses
from validation.synthetic import ArmDescription

MANY = 8
"""Poses drawn for one that is wanted."""


@dataclass(frozen=True)
class HalfRange:
    """One half of the range of a joint, from 1; side of its middle: -1, 1."""

    joint: int
    side: int

    @property
    def other(self) -> HalfRange:
        """The other half."""
        return replace(self, side=-self.side)

    def poses(self, case: Case, arm: ArmDescription, seed: int, count: int) -> Array:
        """(count, N), rad, poses of a case in this half."""
        q, (low, high) = drawn_poses(case, arm, seed, MANY * count), arm.links[self.joint - 1].limits_rad
        return q[self.side * (q[:, self.joint - 1] - 0.5 * (low + high)) >= 0.0][:count]
