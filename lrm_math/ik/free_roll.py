"""How a tool is best turned about its approach direction: where the joints move least."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.batch_closed_form import TURN, Mask

FIRST = 180
"""Samples of the turn, at first."""
FAST, BETWEEN, PARTED = 0.3, 7, 3
"""Where a joint moves further between two samples (rad), so many are put between them; rounds of that.

Near a singular pose of the wrist two joints turn by half a turn while the tool turns by a small part of a degree.
"""
FINE = 13
"""Samples around each that moves the joints less than its neighbours do, in each finer sweep."""
HOPE = 1.0
"""rad beyond the limits from which a sample's surroundings may still lead within.

Where branches meet, joints move as the square root of the turn; so the hope falls with the root of the spacing.
"""
BEYOND = 1e6
"""Worse than any angles within the limits (rad²)."""


@dataclass(frozen=True, eq=False)
class Around:
    """All branches for K turns."""

    q: Array
    """(K, 8, 6), rad."""
    exists: Mask
    """(K, 8)"""
    bad: Array
    """(K, 8), squared distance from the wanted angles (rad²); outside the limits `BEYOND` times 1 and how far (rad)."""

    def and_at(self, turns: Array, more: Array, there: Around) -> tuple[Array, Around]:
        """These and others in the order of the turns."""
        turns = np.append(turns, more)
        order = np.argsort(turns)
        mine, theirs = (self.q, self.exists, self.bad), (there.q, there.exists, there.bad)
        q, exists, bad = (np.concatenate(pair)[order] for pair in zip(mine, theirs, strict=True))
        return turns[order], Around(q, exists, bad)

    def moved(self) -> Array:
        """(K - 1,), how far a joint moves from each turn to the next (rad)."""
        both = self.exists[1:] & self.exists[:-1]
        step = np.abs((np.diff(self.q, axis=0) + np.pi) % TURN - np.pi).max(axis=2)
        return np.asarray(np.where(both, step, 0.0).max(axis=1))


def least(around: Callable[[Array], Around], finest: float) -> Array:
    """(M, 6), angles within the limits that change more if the tool turns a little either way (rad), the best first.

    `finest`: rad, the turns at the end are no further apart.
    """
    turns, here = _swept(around)
    end = np.full((1, here.bad.shape[1]), np.inf)
    before, after = np.vstack([end, here.bad[:-1]]), np.vstack([here.bad[1:], end])
    low = (here.bad <= before) & (here.bad < after) & (here.bad < BEYOND * (1.0 + HOPE))
    row, number = np.nonzero(low)
    q, bad, turn, hope = here.q[low], here.bad[low], turns[row], HOPE
    padded = np.concatenate([turns[:1], turns, turns[-1:]])
    step = np.maximum(turn - padded[row], padded[row + 2] - turn)
    while step.max(initial=0.0) > finest:
        finer = turn[:, None] + step[:, None] * np.linspace(-1.0, 1.0, FINE)
        there = around(finer.ravel())
        own = np.arange(finer.size).reshape(finer.shape), number[:, None]
        best = np.arange(len(turn)), there.bad[own].argmin(axis=1)
        q, bad, turn, step = there.q[own][best], there.bad[own][best], finer[best], step * 2.0 / (FINE - 1)
        hope *= (2.0 / (FINE - 1)) ** 0.5
        kept = bad < BEYOND * (1.0 + hope)
        q, bad, turn, step, number = q[kept], bad[kept], turn[kept], step[kept], number[kept]
    order = np.argsort(bad)
    return np.asarray(q[order[bad[order] < BEYOND]])


def _swept(around: Callable[[Array], Around]) -> tuple[Array, Around]:
    """Turns (K,) all round and what is there, closer together where joints move fast."""
    turns = TURN / FIRST * np.arange(FIRST + 1.0)
    here, share = around(turns), np.arange(1.0, BETWEEN + 1.0) / (BETWEEN + 1.0)
    for _ in range(PARTED):
        fast = np.flatnonzero(here.moved() > FAST)
        if len(fast) == 0:
            break
        more = (turns[fast, None] + np.diff(turns)[fast, None] * share).ravel()
        turns, here = here.and_at(turns, more, around(more))
    return turns, here
