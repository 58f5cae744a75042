"""Memory of the joints' motion: where each was last sent, from which side, and how far its friction is turned over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.friction import TRAVELS_DEG, turned_over

STILL = 1e-9
"""rad: a joint that is sent no further has not moved."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Traces that the commands so far have left.

    Attributes:
        q: (n,), last commands (rad). side: (n,), sign of each joint's last move, 0 while unknown.
        friction: (n, K), states of the elements of dry friction, see `lrm_math.effects.friction`.
    """

    q: Array
    side: Array
    friction: Array

    @classmethod
    def at(cls, q: Sequence[float] | Array) -> Motion:
        """An arm that stands at angles q (n,), rad, and came there from nobody knows where."""
        angles = np.array(q, dtype=np.float64)
        return cls(angles, np.zeros_like(angles), np.zeros((len(angles), len(TRAVELS_DEG))))

    def to(self, q: Array) -> Motion:
        """After a straight move to commands q (n,), rad; joints that stay keep their side."""
        lengths = np.abs(q - self.q)
        side = np.where(lengths > STILL, np.sign(q - self.q), self.side)
        return Motion(q, side, self.turned(q, side))

    def turned(self, q: Array, side: Array) -> Array:
        """(n, K), states of friction after a move to q (n,), rad, that counts as one towards `side` (n,)."""
        return turned_over(self.friction, np.abs(q - self.q), side)
