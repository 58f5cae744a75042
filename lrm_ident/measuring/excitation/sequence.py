"""Moves one after the other as a log of commands (`t_s, q1_deg, …`), with free ways between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lrm_ident.measuring.excitation.excitations import FRAME_S, CollisionFreePaths, ExcitingMove
from lrm_math.arrays import Array

STRAIGHT = 5e-6
"""rad by which a row may lie beside the line of its neighbours to be left out of the knots; `csv` rounds to 1e-6."""


@dataclass(frozen=True, eq=False)
class MoveSequence:
    """Commands q (N, n), rad, at times t (N,), s, straight between."""

    t: Array
    q: Array

    @classmethod
    def of(cls, moves: Sequence[ExcitingMove], ways: CollisionFreePaths, home: Array, speeds: Array) -> MoveSequence:
        """The moves in order, and between them free ways over the `home` posture at speeds (n,), rad/s."""
        t, q = [moves[0].t], [moves[0].q]
        for before, move in pairwise(moves):
            way = ways.between(before.q[-1], move.q[0], home)[1:-1]
            for pose in (*way, move.q[0]):
                seconds = float(np.max(np.abs(pose - q[-1][-1]) / speeds))
                if seconds > 0.0:
                    t.append(t[-1][-1:] + seconds)
                    q.append(pose[None])
            t.append(t[-1][-1] + move.t[1:])
            q.append(move.q[1:])
        knots, poses = np.concatenate(t), np.concatenate(q)
        even = FRAME_S * np.arange(float(np.ceil(knots[-1] / FRAME_S)) + 1.0)
        return cls(even, np.stack([np.interp(even, knots, column) for column in poses.T], axis=1))

    def csv(self) -> str:
        """A log of commands, as `lrm record` writes it."""
        head = ",".join(["t_s", *(f"q{k + 1}_deg" for k in range(self.q.shape[1]))])
        rows = (
            ",".join([f"{t:.5f}", *(f"{angle:.4f}" for angle in row)])
            for t, row in zip(self.t.tolist(), np.degrees(self.q).tolist(), strict=True)
        )
        return "\n".join([head, *rows]) + "\n"

    @property
    def fastest(self) -> Array:
        """(n,), rad/s, of each joint from row to row."""
        return np.asarray(np.max(np.abs(np.diff(self.q, axis=0)) / np.diff(self.t)[:, None], axis=0))

    @property
    def knots(self) -> MoveSequence:
        """The rows between which it is straight."""
        kept = [0]
        for row in range(1, len(self.t) - 1):
            a, b, c = self.t[kept[-1]], self.t[row], self.t[row + 1]
            line = self.q[kept[-1]] + (b - a) / (c - a) * (self.q[row + 1] - self.q[kept[-1]])
            if np.abs(line - self.q[row]).max() > STRAIGHT:
                kept.append(row)
        kept.append(len(self.t) - 1)
        return MoveSequence(self.t[kept], self.q[kept])


@dataclass(frozen=True)
class PlayedRow:
    """At a time (s): angles (n,), rad, that are commanded from then on, and that the encoders read just before."""

    t: float
    command: tuple[float, ...]
    seen: tuple[float, ...]
