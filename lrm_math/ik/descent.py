"""Commands of lesser error within the limits, while the arm gives way as it did nearby."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.linkage import Indices
from lrm_math.ik.pose_error import farness
from lrm_math.ik.solver_context import Deployment

STILL = 1e-5
"""rad: a step that moves no joint further ends the descent."""
LONGEST_STEP = 0.7
"""rad: no joint turns further in one step."""
FLOOR = 1e-5
"""Least curvature that a step trusts, as a share of the largest."""
DAMPING = 0.03
"""After a step that fails: a share of the largest curvature."""
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Bent:
    """K commands `q` (K, n), rad, `amounts` (K, V) of the moving slots there, and how they `follow` (K, V, n)."""

    q: Array
    amounts: Array
    follow: Array

    def at(self, q: Array) -> Array:
        """(K, V), amounts at commands near those."""
        return np.asarray(self.amounts + (self.follow @ (q - self.q)[:, :, None])[:, :, 0])

    def take(self, rows: Indices | NDArray[np.bool_]) -> Bent:
        """Some of them."""
        return Bent(self.q[rows], self.amounts[rows], self.follow[rows])


@dataclass(frozen=True, eq=False)
class Slopes:
    """Half the square of the error, by commands: its `square` (K,), `gradient` (K, n) and `curvature` (K, n, n)."""

    square: Array
    gradient: Array
    curvature: Array

    def where(self, chosen: NDArray[np.bool_], others: Slopes) -> Slopes:
        """These where chosen, and the others elsewhere."""
        return Slopes(
            np.where(chosen, self.square, others.square),
            np.where(chosen[:, None], self.gradient, others.gradient),
            np.where(chosen[:, None, None], self.curvature, others.curvature),
        )


def descend(deployment: Deployment, goal: Goal, bent: Bent, steps: int) -> tuple[Array, Array]:
    """(K, n), commands of lesser error within the limits, and its square (K,), m².

    Newton's method with all curvatures counted as positive, so that it leaves saddles (Dauphin et al. 2014); damped
    where a step fails.
    """
    band, q = deployment.band, bent.q
    here = _slopes(deployment, goal, bent, q)
    damping = np.zeros(len(q))
    for _ in range(steps):
        stuck = ((q <= band.lower) & (here.gradient > 0.0)) | ((q >= band.upper) & (here.gradient < 0.0))
        moved = np.clip(q + _step(here, stuck, damping), band.lower, band.upper)
        if np.abs(moved - q).max() < STILL:
            break
        there = _slopes(deployment, goal, bent, moved)
        better = there.square < here.square
        damping = np.where(better, 0.1 * damping, np.maximum(10.0 * damping, DAMPING))
        q, here = np.where(better[:, None], moved, q), there.where(better, here)
    return q, here.square


def _slopes(deployment: Deployment, goal: Goal, bent: Bent, q: Array) -> Slopes:
    linkage = deployment.compensation.linkage
    placed = linkage.place(bent.at(q))
    missing = farness(placed.tcp, goal)
    J = linkage.jacobian(placed)
    gradient = -((missing.pull[:, None] @ J) @ bent.follow)[:, 0]
    return Slopes(missing.square, gradient, missing.curvature(J[:, :, linkage.joints]))


def _step(here: Slopes, stuck: NDArray[np.bool_], damping: Array) -> Array:
    """(K, n), rad, the step to the least error, without the joints that stay at limits."""
    free = np.where(stuck, 0.0, 1.0)
    size, ways = np.linalg.eigh(here.curvature * free[:, :, None] * free[:, None])
    size = np.abs(size)
    largest = size.max(axis=1, keepdims=True)
    size = np.maximum(size, FLOOR * largest) + damping[:, None] * largest + TINY
    step = -(ways @ ((ways.transpose(0, 2, 1) @ (free * here.gradient)[:, :, None]) / size[:, :, None]))[:, :, 0]
    step *= free
    furthest = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * (LONGEST_STEP / np.maximum(furthest, LONGEST_STEP)))
