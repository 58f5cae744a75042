"""Contact as a permission: which two bodies may come nearer than the margin, where, and how far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array, Vector3
from lrm_math.errors import LrmError


@dataclass(frozen=True)
class ContactPermit:
    """Permission for bodies `first` and `second` to touch while the tip is in a region, and for no others.

    Attributes:
        low, high: corners of the region (m), in the frame of TCP positions.
        depth: m, how deep their shapes may overlap as commanded; below zero: the gap that has to stay.
    """

    first: str
    second: str
    low: Vector3
    high: Vector3
    depth: float = 0.0

    def __post_init__(self) -> None:
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise LrmError(f"contact of {self.first} and {self.second}: its region must start below its end")

    @property
    def pair(self) -> frozenset[str]:
        """Names of the two bodies."""
        return frozenset((self.first, self.second))

    def inside(self, tips: Array) -> Array:
        """(N,), m: how far tips (N, 3) are from the region's nearest face, below zero outside; it changes no faster
        than the tip moves."""
        return np.asarray(np.minimum(tips - self.low, self.high - tips).min(axis=1))

    def applied(self, separation: Array, tips: Array, margin: float) -> Array:
        """Separations (N,) of the pair (m), raised to the margin or more exactly where the contact is permitted.

        The larger of the separation itself and of margin + min(separation + depth, `inside`): none of these changes
        faster than the bodies or the tip move, so the proof of a motion that is free holds for it, too.
        """
        return np.maximum(separation, margin + np.minimum(separation + self.depth, self.inside(tips)))


@dataclass(frozen=True)
class Contact:
    """A contact that a request permits, and the largest `force` (N) with which the arm may press."""

    permit: ContactPermit
    force: float
