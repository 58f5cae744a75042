"""Roll of the tool about its approach direction that minimises joint motion: sampling, then local refinement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.batch_closed_form import TURN
from lrm_math.ik.solver import Mask

FIRST = 180
"""Samples of the first sweep."""
FAST, BETWEEN, PASSES = 0.3, 7, 3
"""Where a joint moves further between two samples (rad), so many are inserted; number of passes.

Near a wrist singularity two joints turn by half a turn while the tool rolls by a small part of a degree.
"""
FINE = 13
"""Samples around each local minimum in each finer sweep."""
NEAR_LIMITS = 1.0
"""rad beyond the limits from which the surroundings of a sample may still lead within.

Where branches merge, joints move as the square root of the roll; so this tolerance falls with the root of the spacing.
"""
BEYOND = 1e6
"""Cost of angles outside the limits, above any within (rad²)."""


@dataclass(frozen=True, eq=False)
class RollSweep:
    """All branches for K roll angles."""

    q: Array
    """(K, 8, 6), rad."""
    exists: Mask
    """(K, 8)"""
    cost: Array
    """(K, 8), squared distance from the preferred angles (rad²); outside the limits `BEYOND` times 1 + excess (rad)."""

    def merged(self, rolls: Array, more: Array, other: RollSweep) -> tuple[Array, RollSweep]:
        """Merges another sweep at roll angles `more`, in ascending order."""
        rolls = np.append(rolls, more)
        order = np.argsort(rolls)
        mine, others = (self.q, self.exists, self.cost), (other.q, other.exists, other.cost)
        q, exists, cost = (np.concatenate(pair)[order] for pair in zip(mine, others, strict=True))
        return rolls[order], RollSweep(q, exists, cost)

    def moved(self) -> Array:
        """(K - 1,), largest joint motion from each roll to the next (rad)."""
        both = self.exists[1:] & self.exists[:-1]
        step = np.abs((np.diff(self.q, axis=0) + np.pi) % TURN - np.pi).max(axis=2)
        return np.asarray(np.where(both, step, 0.0).max(axis=1))


def least_motion_rolls(branches_at: Callable[[Array], RollSweep], finest: float) -> Array:
    """(M, 6), angles within the limits at local minima of the cost over the roll (rad), the best first.

    `finest`: rad, final spacing of the rolls.
    """
    rolls, here = _swept(branches_at)
    end = np.full((1, here.cost.shape[1]), np.inf)
    before, after = np.vstack([end, here.cost[:-1]]), np.vstack([here.cost[1:], end])
    low = (here.cost <= before) & (here.cost < after) & (here.cost < BEYOND * (1.0 + NEAR_LIMITS))
    row, number = np.nonzero(low)
    q, cost, roll, tolerance = here.q[low], here.cost[low], rolls[row], NEAR_LIMITS
    padded = np.concatenate([rolls[:1], rolls, rolls[-1:]])
    step = np.maximum(roll - padded[row], padded[row + 2] - roll)
    while step.max(initial=0.0) > finest:
        finer = roll[:, None] + step[:, None] * np.linspace(-1.0, 1.0, FINE)
        sweep = branches_at(finer.ravel())
        own = np.arange(finer.size).reshape(finer.shape), number[:, None]
        best = np.arange(len(roll)), sweep.cost[own].argmin(axis=1)
        q, cost, roll, step = (sweep.q[own][best], sweep.cost[own][best], finer[best], step * 2.0 / (FINE - 1))
        tolerance *= (2.0 / (FINE - 1)) ** 0.5
        kept = cost < BEYOND * (1.0 + tolerance)
        q, cost, roll, step, number = q[kept], cost[kept], roll[kept], step[kept], number[kept]
    order = np.argsort(cost)
    return np.asarray(q[order[cost[order] < BEYOND]])


def _swept(branches_at: Callable[[Array], RollSweep]) -> tuple[Array, RollSweep]:
    """Roll angles (K,) over the whole turn and their branches, denser where joints move fast."""
    rolls = TURN / FIRST * np.arange(FIRST + 1.0)
    here, share = branches_at(rolls), np.arange(1.0, BETWEEN + 1.0) / (BETWEEN + 1.0)
    for _ in range(PASSES):
        fast = np.flatnonzero(here.moved() > FAST)
        if len(fast) == 0:
            break
        more = (rolls[fast, None] + np.diff(rolls)[fast, None] * share).ravel()
        rolls, here = here.merged(rolls, more, branches_at(more))
    return rolls, here
