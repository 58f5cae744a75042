"""Descent of the pose error over commands within the limits, on an arm linearised about its state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.linkage import Indices
from lrm_math.ik.pose_error import pose_error
from lrm_math.ik.solver_context import SolverContext

STILL = 1e-5
"""rad: a step that moves no joint further ends the descent."""
LONGEST_STEP = 0.7
"""rad, trust region: largest turn of a joint per step."""
FLOOR = 1e-5
"""Lower bound of the curvature, as a share of the largest."""
DAMPING = 0.03
"""Damping after a failed step, as a share of the largest curvature."""
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class LinearisedArm:
    """K commands `q` (K, n), rad, slot `amounts` (K, V) there, and their derivatives `follow` (K, V, n) by q."""

    q: Array
    amounts: Array
    follow: Array

    def at(self, q: Array) -> Array:
        """(K, V), amounts at commands nearby."""
        return np.asarray(self.amounts + (self.follow @ (q - self.q)[:, :, None])[:, :, 0])

    def take(self, rows: Indices | NDArray[np.bool_]) -> LinearisedArm:
        """Selected rows."""
        return LinearisedArm(self.q[rows], self.amounts[rows], self.follow[rows])


@dataclass(frozen=True, eq=False)
class QuadraticModel:
    """Half the squared error as a function of commands: its `square` (K,), `gradient` (K, n), `curvature` (K, n, n)."""

    square: Array
    gradient: Array
    curvature: Array

    def where(self, chosen: NDArray[np.bool_], others: QuadraticModel) -> QuadraticModel:
        """These rows where chosen, the others elsewhere."""
        return QuadraticModel(
            np.where(chosen, self.square, others.square),
            np.where(chosen[:, None], self.gradient, others.gradient),
            np.where(chosen[:, None, None], self.curvature, others.curvature),
        )


def descend(context: SolverContext, goal: Goal, arm: LinearisedArm, steps: int) -> tuple[Array, Array]:
    """(K, n), commands of lesser error within the limits, and its square (K,), m².

    Newton's method with the absolute values of all curvatures, so that it leaves saddles (saddle-free Newton, Dauphin
    et al. 2014); damped where a step fails.
    """
    bounds, q = context.bounds, arm.q
    here = _quadratic_model(context, goal, arm, q)
    damping = np.zeros(len(q))
    for _ in range(steps):
        stuck = ((q <= bounds.lower) & (here.gradient > 0.0)) | ((q >= bounds.upper) & (here.gradient < 0.0))
        moved = np.clip(q + _step(here, stuck, damping), bounds.lower, bounds.upper)
        if np.abs(moved - q).max() < STILL:
            break
        there = _quadratic_model(context, goal, arm, moved)
        better = there.square < here.square
        damping = np.where(better, 0.1 * damping, np.maximum(10.0 * damping, DAMPING))
        q, here = np.where(better[:, None], moved, q), there.where(better, here)
    return q, here.square


def _quadratic_model(context: SolverContext, goal: Goal, arm: LinearisedArm, q: Array) -> QuadraticModel:
    linkage = context.linkage
    state = linkage.forward(arm.at(q))
    error = pose_error(state.tcp, goal)
    J = linkage.jacobian(state)
    gradient = -((error.pull[:, None] @ J) @ arm.follow)[:, 0]
    return QuadraticModel(error.square, gradient, error.curvature(J[:, :, linkage.joints]))


def _step(here: QuadraticModel, stuck: NDArray[np.bool_], damping: Array) -> Array:
    """(K, n), rad, the step to the minimum of the quadratic model, joints at active limits fixed."""
    free = np.where(stuck, 0.0, 1.0)
    size, vectors = np.linalg.eigh(here.curvature * free[:, :, None] * free[:, None])
    size = np.abs(size)
    largest = size.max(axis=1, keepdims=True)
    size = np.maximum(size, FLOOR * largest) + damping[:, None] * largest + TINY
    step = -(vectors @ ((vectors.transpose(0, 2, 1) @ (free * here.gradient)[:, :, None]) / size[:, :, None]))[:, :, 0]
    step *= free
    furthest = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * (LONGEST_STEP / np.maximum(furthest, LONGEST_STEP)))
