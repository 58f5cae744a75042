"""Record of an arm's moves: where each joint was last sent, from which side, and how far its friction has turned over.

One record for whoever follows an arm: a daemon, move by move, and a file of poses in the order in which they were
measured. So both see the same direction and the same friction.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array

TRAVELS_DEG = (2, 8, 30)
"""Moves after which each element of dry friction has turned over by 63 %."""
STILL = 1e-9
"""rad: a joint that is sent no further has not moved."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Traces that the commands so far have left.

    Attributes:
        q: (n,), last commands (rad). side: (n,), sign of each joint's last move, 0 while unknown.
        friction: (n, K), states (−1 … 1) of an element of Dahl friction for each of `TRAVELS_DEG`, 0 while unknown.
            Each obeys ds/dq = (sign(dq) − s)/travel along straight moves (Dahl 1968, exponent 1).
    """

    q: Array
    side: Array
    friction: Array

    @classmethod
    def at(cls, q: Sequence[float] | Array) -> Motion:
        """An arm that stands at angles q (n,), rad, and came there from nobody knows where."""
        angles = np.array(q, dtype=np.float64)
        return cls(angles, np.zeros_like(angles), np.zeros((len(angles), len(TRAVELS_DEG))))

    @classmethod
    def towards(cls, q: Sequence[float] | Array, side: Sequence[float] | Array) -> Motion:
        """An arm whose joints came to angles q (n,), rad, by long moves towards `side` (n,), which turned over all
        friction; 0: nobody knows from where."""
        signs = np.array(side, dtype=np.float64)
        return cls(np.array(q, dtype=np.float64), signs, np.repeat(signs[:, None], len(TRAVELS_DEG), axis=1))

    @classmethod
    def between(cls, start: Sequence[float] | Array, q: Sequence[float] | Array) -> Motion:
        """An arm that went straight from `start` to q, both (n,), rad, and of which nothing else is known: the move
        counts as a long one, and of joints that stayed nothing is known."""
        return cls.towards(q, Motion.at(start).to(np.asarray(q, dtype=np.float64)).side)

    def to(self, q: Array, still: float = STILL) -> Motion:
        """After a straight move to commands q (n,), rad; a joint that is sent no further than `still` (rad) stays.

        A move in several parts, without a turn between them, leaves the same traces as one.
        """
        moved = np.abs(q - self.q) > still
        side = np.where(moved, np.sign(q - self.q), self.side)
        return Motion(q, side, turned_over(self.friction, np.where(moved, np.abs(q - self.q), 0.0), side))

    def turned(self, q: Array, side: Array) -> Array:
        """(n, K), states of friction after a move to q (n,), rad, that counts as one towards `side` (n,)."""
        return turned_over(self.friction, np.abs(q - self.q), side)

    def forgotten(self, joints: NDArray[np.bool_]) -> Motion:
        """The same record, in which nothing is known of how some `joints` (n,) came to where they are."""
        return Motion(self.q, np.where(joints, 0.0, self.side), np.where(joints[:, None], 0.0, self.friction))


def turned_over(states: Array, lengths: Array, side: Array) -> Array:
    """(n, K), friction states (n, K) after straight moves of the joints by `lengths` (n,), rad, towards `side` (n,)."""
    kept = np.exp(-lengths[:, None] / np.radians(TRAVELS_DEG))
    return np.asarray(side[:, None] + kept * (states - side[:, None]))


def motions(q: Array, start: Array | None, gap: NDArray[np.bool_] | None = None) -> Iterator[Motion]:
    """The record at each of several poses, after straight moves from one to the next.

    Args:
        q: (N, n), commanded angles in the measured order (rad).
        start: (n,), angles before the first pose, if known: the first move counts as a long one.
        gap: (N,), whether a pose is missing before; nothing is known there of the moves so far.
    """
    record: Motion | None = None
    for row, angles in enumerate(q):
        if record is None:
            record = Motion.at(angles) if start is None else Motion.between(start, angles)
        else:
            record = Motion.at(angles) if gap is not None and gap[row] else record.to(angles)
        yield record


def recorded(q: Array, start: Array | None, gap: NDArray[np.bool_] | None = None) -> tuple[Array, Array]:
    """Sign of each joint's last move (N, n), and states of friction (N, n, K), at poses (N, n); see `motions`."""
    recorded_motions = [*motions(q, start, gap)]
    side = [record.side for record in recorded_motions]
    friction = [record.friction for record in recorded_motions]
    n = q.shape[1]
    return np.array(side).reshape(-1, n), np.array(friction).reshape(-1, n, len(TRAVELS_DEG))
