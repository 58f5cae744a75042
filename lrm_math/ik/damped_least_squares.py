"""Damped least squares for arms and goals without a closed form: any number of joints, limits kept on the way.

The residual of a goal, whose square is what "nearest" means: the way from the TCP to the position asked for (m), and
for orientations and approach directions the chords from the tool's axes to those asked for, times the arm's length,
so that a turn by one radian counts like a move by that length. Damping follows the residual (Sugihara 2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.linkage import Linkage, Placed, cross, linkage_of
from lrm_math.kinematics.chain import Chain

MOST_STEPS = 120
"""Of a descent."""
SOLVED = 1e-11
"""Share of the arm's length below which a residual is nothing."""
LEAST_DAMPING = 1e-5
"""Of the damping that follows the residual, so that steps near a singularity stay finite."""
SETTLED = 1e-5
"""rad: a slide whose steps are no longer has found the least motion."""
STILL = 1e-9
"""rad: a step that moves no joint further than this ends a descent."""


@dataclass(frozen=True, eq=False)
class Targets:
    """Goals of one kind as arrays.

    Attributes:
        position: (3, K), m.
        axes: which axes of the tool are given a direction, and `direction` (A, 3, K), which.
        weight: m per unit of chord.
    """

    position: Array
    axes: tuple[int, ...]
    direction: Array
    weight: float

    @classmethod
    def of(cls, goals: Sequence[Goal], length: float) -> Targets:
        """Goals of the same kind, for an arm of some length (m)."""
        position = np.array([goal.position for goal in goals]).T
        if goals[0].rotation is not None:
            return cls.poses(position.T, np.array([goal.rotation for goal in goals]), length)
        if goals[0].approach is not None:
            return cls(position, (2,), np.array([goal.approach for goal in goals]).T[None], length)
        return cls(position, (), np.empty((0, 3, len(goals))), length)

    @classmethod
    def poses(cls, positions: Array, rotations: Array, length: float) -> Targets:
        """Full poses: (K, 3) in m, (K, 3, 3)."""
        return cls(positions.T, (0, 1, 2), rotations.transpose(2, 1, 0), length / 2**0.5)

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Targets:
        """Some of the goals."""
        return Targets(self.position[:, chosen], self.axes, self.direction[:, :, chosen], self.weight)

    def residual(self, at: Placed) -> Array:
        """(K, m), what is missing: m."""
        tool = at.tcp.T
        parts = [self.position - tool[3, :3]]
        parts += [self.weight * (d - tool[axis, :3]) for axis, d in zip(self.axes, self.direction, strict=True)]
        return np.concatenate(parts).T


@dataclass(frozen=True, eq=False)
class NominalArm:
    """The arm as drawn, all between its joints welded together. `zero`: (n,), the joints' slots at q = 0 (rad)."""

    linkage: Linkage
    zero: Array

    @classmethod
    def of(cls, chain: Chain) -> NominalArm:
        """The nominal arm of a chain."""
        steady = [float(amount) for amount in chain.values([0.0] * chain.dof)]
        return cls(linkage_of(chain, steady, ()), np.array([steady[k] for k in chain.joint_slots]))

    def placed(self, q: Array) -> Placed:
        """Where it stands at angles q (K, n)."""
        return self.linkage.place(self.zero + q)


def jacobian(at: Placed, targets: Targets) -> Array:
    """(K, m, n), how the joints lessen the residual (m/rad)."""
    tool = at.tcp.T
    parts = [cross(at.axis, tool[3, :3] - at.origin)]
    parts += [targets.weight * cross(at.axis, tool[None, k, :3]) for k in targets.axes]
    return np.concatenate(parts, axis=1).transpose(2, 1, 0)


def descend(
    arm: NominalArm, targets: Targets, start: Array, lower: Array, upper: Array, length: float, steps: int = MOST_STEPS
) -> tuple[Array, Array]:
    """Angles (K, n) at a least residual within the limits, one per start (K, n), and the residuals' size (K,) in m."""
    q = np.clip(start, lower, upper)
    at = arm.placed(q)
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
        at, some = arm.placed(moved), targets.take(going)
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
    """(K, n), the damped step; joints that stand at a limit and are pushed against it keep still (rad)."""
    pull = np.einsum("kmn,km->kn", J, e)
    stuck = ((q <= lower) & (pull < 0.0)) | ((q >= upper) & (pull > 0.0))
    J = np.where(stuck[:, None], 0.0, J)
    normal = np.einsum("kmi,kmj->kij", J, J) + damping[:, None, None] * np.eye(J.shape[2])
    return np.asarray(np.linalg.solve(normal, np.einsum("kmn,km->kn", J, e)[..., None])[..., 0])


def slide(
    arm: NominalArm,
    targets: Targets,
    q: Array,
    towards: Array,
    lower: Array,
    upper: Array,
    length: float,
    steps: int = 20,
) -> tuple[Array, Array]:
    """Along the goals' free directions as near to the angles `towards` (n,) as the limits let; as `descend` returns.

    Each step goes to the nearest point of the tangent: least motion subject to the linearised goal.
    """
    q = q.copy()
    for _ in range(steps):
        at = arm.placed(q)
        e, J = targets.residual(at), jacobian(at, targets)
        wish = towards - q
        stuck = ((q <= lower) & (wish < 0.0)) | ((q >= upper) & (wish > 0.0))
        wish, J = np.where(stuck, 0.0, wish), np.where(stuck[:, None], 0.0, J)
        gram = np.einsum("kin,kjn->kij", J, J) + 1e-10 * length**2 * np.eye(J.shape[1])
        missing = e - np.einsum("kmn,kn->km", J, wish)
        step = wish + np.einsum("kmn,km->kn", J, np.linalg.solve(gram, missing[..., None])[..., 0])
        large = np.abs(step).max(axis=1, keepdims=True)
        step *= np.minimum(1.0, 0.5 / np.maximum(large, 1e-12))
        q = np.clip(q + step, lower, upper)
        if large.max() < SETTLED:
            break
    return descend(arm, targets, q, lower, upper, length)
