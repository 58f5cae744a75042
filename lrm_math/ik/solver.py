"""Interface of the inverse of the nominal arm."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.answer import Branch, NominalAnswer
from lrm_math.ik.goal import Goal

Mask = NDArray[np.bool_]
BRANCHES = 8


@dataclass(frozen=True, eq=False)
class BatchAnswer:
    """The branches of N poses. No NaN anywhere.

    Attributes:
        q: (N, 8, n), rad; meaningless where not valid.
        valid: (N, 8), whether the branch exists and keeps the limits.
        singular: (N, 8), whether it is one of a family; `solve` looks for others within the limits, this does not.
    """

    q: Array
    valid: Mask
    singular: Mask

    @property
    def solved(self) -> Mask:
        """(N,), whether there is a branch within the limits."""
        return np.asarray(self.valid.any(axis=1))


class NominalSolver(ABC):
    """Joint angles of one arm for goals of any kind."""

    arm: Arm

    @abstractmethod
    def solve(self, goal: Goal, near: Sequence[float] | None = None) -> NominalAnswer:
        """All branches of a pose, or representatives of each family where the goal leaves motion free.

        `near`: (n,), joint angles (rad): branches come nearest first, free motion stays near; without it, both keep
        away from the limits. Raises `LrmError` if they are not n finite angles.
        """

    @abstractmethod
    def partial_branches(self, goal: Goal, near: Sequence[float] | None = None) -> tuple[Branch, ...]:
        """The branches of a goal without orientation, as of `solve`, without a diagnosis where there are none."""

    @abstractmethod
    def solve_batch(self, positions: ArrayLike, rotations: ArrayLike) -> BatchAnswer:
        """All branches of N poses: positions (N, 3) in m, rotations (N, 3, 3).

        Raises `LrmError`: wrong shapes, numbers that are not finite, or matrices that are no rotations.
        """


def angles_near(near: Sequence[float] | None, dof: int) -> Array | None:
    """(n,), checked reference angles. Raises `LrmError`."""
    if near is None:
        return None
    q = np.asarray(near, dtype=np.float64)
    if q.shape != (dof,) or not np.isfinite(q).all():
        raise LrmError(f"near = {near}; should be {dof} finite joint angles in rad")
    return q


def poses_checked(positions: ArrayLike, rotations: ArrayLike) -> tuple[Array, Array]:
    """Checked positions (N, 3) and rotations (N, 3, 3). Raises `LrmError`."""
    p, R = np.asarray(positions, dtype=np.float64), np.asarray(rotations, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or R.shape != (len(p), 3, 3):
        raise LrmError(f"positions have shape {p.shape} and rotations {R.shape}; should be (N, 3) and (N, 3, 3)")
    finite = np.isfinite(p).all(axis=1) & np.isfinite(R).all(axis=(1, 2))
    if not finite.all():
        raise LrmError(f"goal {int(np.argmin(finite)) + 1}: position or rotation is not finite")
    return p, R
