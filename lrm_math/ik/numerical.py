"""Inverse of arms without a closed form: every branch that a multi-start search finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lrm_math.arm.arm import Arm
from lrm_math.ik.answer import Branch, NominalAnswer
from lrm_math.ik.goal import Goal, pose
from lrm_math.ik.multi_start import MultiStart
from lrm_math.ik.solver import BRANCHES, BatchAnswer, NominalSolver, angles_near, poses_checked


@dataclass(frozen=True, eq=False)
class Numerical(NominalSolver):
    """Damped least squares from many starts. Branches may be missed; those given are exact.

    That a goal is out of reach is not proven, but found from all starts.
    """

    arm: Arm
    search: MultiStart

    @classmethod
    def of(cls, arm: Arm) -> Numerical:
        """For any arm."""
        return cls(arm, MultiStart.of(arm))

    def solve(self, goal: Goal, near: Sequence[float] | None = None) -> NominalAnswer:
        return self.search.answer(goal, angles_near(near, self.arm.dof))

    def partial_branches(self, goal: Goal, near: Sequence[float] | None = None) -> tuple[Branch, ...]:
        return self.search.branches(goal, angles_near(near, self.arm.dof), 0)

    def solve_batch(self, positions: ArrayLike, rotations: ArrayLike) -> BatchAnswer:
        p, R = poses_checked(positions, rotations)
        q = np.zeros((len(p), BRANCHES, self.arm.dof))
        valid, singular = np.zeros((2, len(p), BRANCHES), dtype=np.bool_)
        for i, (position, rotation) in enumerate(zip(p, R, strict=True)):
            answer = self.solve(pose(position, rotation))
            for j, branch in enumerate(answer.branches[:BRANCHES]):
                q[i, j], valid[i, j], singular[i, j] = branch.q, True, branch.free is not None
        return BatchAnswer(q, valid, singular)
