"""Poses that are measured, and poses that are asked for afterwards, among those that a case draws."""

from __future__ import annotations

from dataclasses import dataclass

from lrm_math.arrays import Array
from validation.hidden_effects.case import Case
from validation.hidden_effects.data import drawn_poses
from validation.synthetic import ArmDescription


class PoseChoice:
    """Poses as the case draws them, measured and fresh ones alike. Joints from 1, angles (P, N) in rad."""

    many = 1
    """Poses drawn for one that is wanted."""

    def measured(self, case: Case, arm: ArmDescription, seed: int, count: int) -> Array:
        """(count, N), measured poses."""
        return drawn_poses(case, arm, seed, self.many * count)[:count]

    def fresh(self, case: Case, arm: ArmDescription, seed: int, count: int) -> Array:
        """(count, N), fresh poses."""
        return drawn_poses(case, arm, seed, self.many * count)[:count]


@dataclass(frozen=True)
class HalfRange(PoseChoice):
    """One half of a joint's range is measured, fresh poses lie in the other. side of its middle: -1, 1."""

    joint: int
    side: int
    many = 8

    def measured(self, case: Case, arm: ArmDescription, seed: int, count: int) -> Array:
        return self._on(self.side, case, arm, seed, count)

    def fresh(self, case: Case, arm: ArmDescription, seed: int, count: int) -> Array:
        return self._on(-self.side, case, arm, seed, count)

    def _on(self, side: int, case: Case, arm: ArmDescription, seed: int, count: int) -> Array:
        q, (low, high) = drawn_poses(case, arm, seed, self.many * count), arm.links[self.joint - 1].limits_rad
        return q[side * (q[:, self.joint - 1] - 0.5 * (low + high)) >= 0.0][:count]
