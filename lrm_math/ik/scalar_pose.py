"""A single commanded pose, its numbers extracted from the arrays once for effects that read them many times."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from numpy.typing import ArrayLike

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses


@dataclass(frozen=True, eq=False)
class SinglePose(Poses):
    """`Poses` of length one.

    Raises `LrmError`: not one pose.
    """

    def __post_init__(self) -> None:
        if self.q.shape[:1] != (1,) or self.payload.shape != (1,):
            raise LrmError(
                f"one pose: q has shape {self.q.shape} and payload {self.payload.shape}; should have one row"
            )

    @classmethod
    def of(cls, poses: Poses, row: int, q: Array) -> SinglePose:
        """One row of some poses, with the angles q (n,) instead of its own (rad)."""
        kept = poses.one(row)
        given = (kept.direction, kept.t, kept.session, kept.temperature, kept.number, kept.friction, kept.running)
        return cls(q[None], kept.payload, *given)

    @cached_property
    def _angles(self) -> list[float]:
        return list(self.q[0].tolist())

    @cached_property
    def _sides(self) -> list[float]:
        return [0.0] * len(self._angles) if self.direction is None else list(self.direction[0].tolist())

    @cached_property
    def _load(self) -> float:
        return float(self.payload[0])

    def angle(self, joint: int) -> Number:
        """Commanded angle of joint number `joint` from 0 (rad)."""
        return self._angles[joint]

    def approach(self, joint: int) -> Number:
        """Sign of the last move of joint number `joint` from 0, 0 where unknown."""
        return self._sides[joint]

    @property
    def carried(self) -> Number:
        """Load carried (kg)."""
        return self._load

    def take(self, rows: ArrayLike) -> Poses:
        """The pose repeated once per row, perhaps never."""
        given = (self.direction, self.t, self.session, self.temperature, self.number, self.friction, self.running)
        return Poses(self.q, self.payload, *given).take(rows)

    def turned_to(self, q: Array) -> SinglePose:
        """The same pose with other angles (n,), rad."""
        given = (self.direction, self.t, self.session, self.temperature, self.number, self.friction, self.running)
        return SinglePose(q[None], self.payload, *given)
