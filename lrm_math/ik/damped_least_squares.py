"""Damped least squares within joint limits, for arms and goals without a closed form, any number of joints.

The residual of a goal, whose square "nearest" minimises: displacement of the TCP (m) and, for orientations and approach
directions, chords between the tool's axes and those of the goal, times the arm's length, so that a turn by one radian
counts like a move by that length. Damping follows the residual (Sugihara 2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.linkage import Linkage, LinkageState, cross, linkage_of
from lrm_math.kinematics.chain import Chain

MOST_STEPS = 120
"""Of a descent."""
SOLVED = 1e-11
"""Share of the arm's length below which a residual is zero."""
LEAST_DAMPING = 1e-5
"""Lower bound of the damping, so that steps near a singularity stay finite."""
SETTLED = 1e-5
"""rad: a slide whose steps are no longer has found the least motion."""
STILL = 1e-9
"""rad: a step that moves no joint further than this ends a descent."""


@dataclass(frozen=True, eq=False)
class TargetBatch:
    """Goals of one kind as arrays.

    `position`: (3, K), m. `axes`: constrained axes of the tool, and `direction` (A, 3, K), their directions. `weight`:
    m per unit of chord.
    """

    position: Array
    axes: tuple[int, ...]
    direction: Array
    weight: float

    @classmethod
    def of(cls, goals: Sequence[Goal], length: float) -> TargetBatch:
        """Goals of the same kind, for an arm of some length (m)."""
        position = np.array([goal.position for goal in goals]).T
        if goals[0].rotation is not None:
            return cls.poses(position.T, np.array([goal.rotation for goal in goals]), length)
        if goals[0].approach is not None:
            return cls(position, (2,), np.array([goal.approach for goal in goals]).T[None], length)
        return cls(position, (), np.empty((0, 3, len(goals))), length)

    @classmethod
    def poses(cls, positions: Array, rotations: Array, length: float) -> TargetBatch:
        """Full poses: (K, 3) in m, (K, 3, 3)."""
        return cls(positions.T, (0, 1, 2), rotations.transpose(2, 1, 0), length / 2**0.5)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> TargetBatch:
        """Selected goals."""
        return TargetBatch(self.position[:, chosen], self.axes, self.direction[:, :, chosen], self.weight)

    def residual(self, at: LinkageState) -> Array:
        """(K, m), m."""
        tool = at.tcp.T
        parts = [self.position - tool[3, :3]]
        parts += [self.weight * (d - tool[axis, :3]) for axis, d in zip(self.axes, self.direction, strict=True)]
        return np.concatenate(parts).T


@dataclass(frozen=True, eq=False)
class NominalArm:
    """The nominal arm, everything between its joints welded. `zero`: (n,), the joints' slots at q = 0 (rad)."""

    linkage: Linkage
    zero: Array

    @classmethod
    def of(cls, chain: Chain) -> NominalArm:
        """The nominal arm of a chain."""
        constants = [float(amount) for amount in chain.values([0.0] * chain.dof)]
        return cls(linkage_of(chain, constants, ()), np.array([constants[k] for k in chain.joint_slots]))

    def forward(self, q: Array) -> LinkageState:
        """Forward kinematics at angles q (K, n)."""
        return self.linkage.forward(self.zero + q)


def jacobian(at: LinkageState, targets: TargetBatch) -> Array:
    """(K, m, n), negative derivative of the residual by the joints (m/rad)."""
    tool = at.tcp.T
    parts = [cross(at.axis, tool[3, :3] - at.origin)]
    parts += [targets.weight * cross(at.axis, tool[None, k, :3]) for k in targets.axes]
    return np.concatenate(parts, axis=1).transpose(2, 1, 0)


def descend(
    arm: NominalArm,
    targets: TargetBatch,
    start: Array,
    lower: Array,
    upper: Array,
    length: float,
    steps: int = MOST_STEPS,
) -> tuple[Array, Array]:
    """Local minima of the residual within the limits: angles (K, n), one per start (K, n), and residuals (K,) in m."""
    q = np.clip(start, lower, upper)
    at = arm.forward(q)
    e, J = targets.residual(at), jacobian(at, targets)
    cost, damping = np.einsum("km,km->k", e, e), np.full(len(q), 1.0)
    going = np.arange(len(q))
    for _ in range(steps):
        going = going[(cost[going] > (SOLVED * length) ** 2) & (damping[going] < 1e12)]
        if len(going) == 0:
            break
        step = _step(J[going], e[going], q[going], lower, upper, damping[going] * (cost[going] + 1e-9 * length**2))
        moved = np.clip(q[going] + step, lower, upper)
        still = np.abs(moved - q[going]).max(axis=1) < STILL
        at, some = arm.forward(moved), targets.take(going)
        new_e = some.residual(at)
        new = np.einsum("km,km->k", new_e, new_e)
        better = new < cost[going]
        damping[going] = np.maximum(damping[going] * np.where(better, 0.2, 5.0), LEAST_DAMPING)
        damping[going[still]] = np.inf
        if better.any():
            kept = going[better]
            q[kept], cost[kept], e[kept] = moved[better], new[better], new_e[better]
            J[kept] = jacobian(at, some)[better]
    return q, np.sqrt(cost)


def _step(J: Array, e: Array, q: Array, lower: Array, upper: Array, damping: Array) -> Array:
    """(K, n), the damped step (rad); joints at an active limit keep still."""
    gradient = np.einsum("kmn,km->kn", J, e)
    stuck = ((q <= lower) & (gradient < 0.0)) | ((q >= upper) & (gradient > 0.0))
    J = np.where(stuck[:, None], 0.0, J)
    normal = np.einsum("kmi,kmj->kij", J, J) + damping[:, None, None] * np.eye(J.shape[2])
    return np.asarray(np.linalg.solve(normal, np.einsum("kmn,km->kn", J, e)[..., None])[..., 0])


def slide(
    arm: NominalArm,
    targets: TargetBatch,
    q: Array,
    towards: Array,
    lower: Array,
    upper: Array,
    length: float,
    steps: int = 20,
) -> tuple[Array, Array]:
    """Null-space motion within the limits, as near to the angles `towards` (n,) as possible; returns as `descend`.

    Each step goes to the nearest point of the tangent: least motion subject to the linearised goal.
    """
    q = q.copy()
    for _ in range(steps):
        at = arm.forward(q)
        e, J = targets.residual(at), jacobian(at, targets)
        preferred = towards - q
        stuck = ((q <= lower) & (preferred < 0.0)) | ((q >= upper) & (preferred > 0.0))
        preferred, J = np.where(stuck, 0.0, preferred), np.where(stuck[:, None], 0.0, J)
        gram = np.einsum("kin,kjn->kij", J, J) + 1e-10 * length**2 * np.eye(J.shape[1])
        missing = e - np.einsum("kmn,kn->km", J, preferred)
        step = preferred + np.einsum("kmn,km->kn", J, np.linalg.solve(gram, missing[..., None])[..., 0])
        large = np.abs(step).max(axis=1, keepdims=True)
        step *= np.minimum(1.0, 0.5 / np.maximum(large, 1e-12))
        q = np.clip(q + step, lower, upper)
        if large.max() < SETTLED:
            break
    return descend(arm, targets, q, lower, upper, length)
