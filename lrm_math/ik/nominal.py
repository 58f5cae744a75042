"""Inverse of the nominal arm: a closed form where three axes intersect, Newton's method from many starts elsewhere."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from operator import itemgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arm.arm import Arm, checked_angles
from lrm_math.arrays import Array, Vector3
from lrm_math.errors import LrmError
from lrm_math.ik.answer import Branch, IkVerdict, Nearest, NominalAnswer, distinct
from lrm_math.ik.goal import Goal, pose
from lrm_math.ik.kernel.kernel_model import frames_as_numbers, goal_numbers
from lrm_math.ik.kernel.shared_library import BRANCHES, Integer, Real, kernel
from lrm_math.ik.packed_arm import PackedArm
from lrm_math.kinematics.screw_axes import screw_axes_of
from lrm_math.model.model import model_of

Mask = NDArray[np.bool_]
STARTS = (24, 200)
"""Starts for goals that leave motion free, at first and before they are given up."""
REPRESENTATIVES, ELSEWHERE = 4, 0.1
"""Most representatives of the families of such a goal, and their least distance (rad)."""
MOST_BEYOND = 8
"""Number of branches beyond the limits in an answer."""
MARGIN = itemgetter(1)
SIX, EIGHT_KINDS = struct.Struct("6d"), struct.Struct("8i")
Angles, Margins, Kinds = (kind * size for kind, size in ((Real, 6 * BRANCHES), (Real, BRANCHES), (Integer, BRANCHES)))


@dataclass(frozen=True, eq=False)
class BatchAnswer:
    """The branches of N poses. No NaN anywhere.

    Attributes:
        q: (N, 8, n), rad; meaningless where not valid.
        valid: (N, 8), whether the branch exists and keeps the limits.
        singular: (N, 8), whether it is one of a family.
    """

    q: Array
    valid: Mask
    singular: Mask

    @property
    def solved(self) -> Mask:
        """(N,), whether there is a branch within the limits."""
        return np.asarray(self.valid.any(axis=1))


@dataclass(frozen=True, eq=False)
class NominalSolver(PackedArm):
    """Joint angles of an arm that nothing deflects, for goals of any kind.

    Without a closed form branches may be missed; those given are exact.
    """

    @classmethod
    @lru_cache(maxsize=64)
    def of(cls, arm: Arm) -> NominalSolver:
        """Solver of any arm, made once; `LrmError` when it is first asked, for one that the kernel has no room for."""
        return cls(model_of(arm, ()))

    def solve(self, goal: Goal, near: Sequence[float] | None = None) -> NominalAnswer:
        """All branches of a pose, or representatives of each family where the goal leaves motion free.

        `near`: (n,), joint angles (rad): branches come nearest first, free motion stays near; without it, both keep
        away from the limits. Raises `LrmError` if they are not n finite angles.
        """
        branches = self.branches(goal, near)
        if not branches:
            return self._unsolved(goal, None if near is None else tuple(near))
        singularity = self._singularity(branches)
        verdict = IkVerdict.SINGULAR if singularity else IkVerdict.SOLVED
        return NominalAnswer(verdict, branches, singularity=singularity)

    def branches(self, goal: Goal, near: Sequence[float] | None = None) -> tuple[Branch, ...]:
        """The branches of `solve`, without a diagnosis where there are none."""
        near = None if near is None else checked_angles("near", near, self.packed.joints)
        if goal.rotation is None or self.form is None:
            branches = self._searched(goal, near)
        else:
            branches = self._closed(goal, near, True)
        if len(branches) < 2:
            return branches
        if near is None:
            return tuple(sorted(branches, key=MARGIN, reverse=True))
        return tuple(sorted(branches, key=lambda branch: branch.distance(near)))

    @cached_property
    def second_axis(self) -> Vector3:
        """A point on the second joint's axis (m), about the middle of the workspace."""
        x, y, z = screw_axes_of(self.model.arm).point[min(1, self.model.arm.dof - 1)].tolist()
        return x, y, z

    def solve_batch(self, positions: ArrayLike, rotations: ArrayLike) -> BatchAnswer:
        """All branches of N poses: positions (N, 3) in m, rotations (N, 3, 3).

        Raises `LrmError`: wrong shapes, numbers that are not finite, or matrices that are no rotations.
        """
        p, R = poses_checked(positions, rotations)
        n, count = self.model.arm.dof, len(p)
        q, kind = np.zeros((count, BRANCHES, n)), np.full((count, BRANCHES), -1, dtype=np.int32)
        goals = frames_as_numbers(p, R)
        if self.form is not None:
            self._nominal(count, goals.ctypes.data, self._middle, True, q.ctypes.data, kind.ctypes.data, None)
            return BatchAnswer(q, kind >= 0, kind > 0)
        for i in range(count):
            for k, branch in enumerate(self._searched(pose(p[i], R[i]), None)[:BRANCHES]):
                q[i, k], kind[i, k] = branch.q, 0
        return BatchAnswer(q, kind >= 0, kind > 0)

    @cached_property
    def _nominal(self) -> Callable[..., None]:
        """The closed form of this arm in the kernel."""
        return partial(kernel().ik_nominal, self.packed.address)

    @cached_property
    def _middle(self) -> bytes:
        """Middle of the limits, as the kernel takes it."""
        return SIX.pack(*self.limits.middle)

    @cached_property
    def _all_round(self) -> NominalSolver:
        """The same arm with joints that turn half a turn either way."""
        arm, middle = self.model.arm, self.limits.middle
        joints = (replace(j, lower=x - np.pi, upper=x + np.pi) for j, x in zip(arm.joints, middle, strict=True))
        return NominalSolver.of(replace(arm, joints=tuple(joints)))

    def _closed(self, goal: Goal, near: tuple[float, ...] | None, limited: bool) -> tuple[Branch, ...]:
        """The branches by the closed form."""
        q, margin, kind, towards = Angles(), Margins(), Kinds(), self._middle if near is None else SIX.pack(*near)
        self._nominal(1, goal_numbers(goal), towards, limited, q, kind, margin)
        kinds = enumerate(EIGHT_KINDS.unpack(kind))
        branches = [
            Branch(SIX.unpack_from(q, SIX.size * k), margin[k], k, free or None) for k, free in kinds if free >= 0
        ]
        return tuple(branches)

    def _branch(self, q: tuple[float, ...]) -> Branch:
        return Branch(q, min(self.limits.margins(q)))

    def _searched(self, goal: Goal, near: tuple[float, ...] | None) -> tuple[Branch, ...]:
        """Branches by search."""
        n, towards = self.model.arm.dof, near or self.limits.middle
        result, determined = self.kernel(0.0).search(goal, towards, near, STARTS), goal.constraints >= n
        within = (at for at in result.at[: result.count] if at.excess <= 0.0)
        branches = [self._branch(self.limits.clipped(at.q[:n])) for at in within]
        if determined:
            return tuple(branches)
        branches.sort(key=lambda branch: branch.distance(tuple(towards)))
        return tuple(distinct(branches, ELSEWHERE)[:REPRESENTATIVES])

    def _unsolved(self, goal: Goal, near: tuple[float, ...] | None) -> NominalAnswer:
        """Reason why a goal has no solution within the limits: solved beyond them, or not at all; the nearest goal."""
        if goal.rotation is not None and self.form is not None:
            branches = self._closed(goal, near, False)
        else:
            branches = tuple(self._branch(b.q) for b in self._all_round._searched(goal, near))
        ordered = tuple(sorted(branches, key=MARGIN, reverse=True))[:MOST_BEYOND]
        result = self.kernel(0.0).nearest(goal, [near or self.limits.middle, *(branch.q for branch in ordered)])
        nearest = None if result is None else Nearest.at(result[0], goal, result[1])
        if not ordered:
            return NominalAnswer(IkVerdict.OUT_OF_REACH, (), nearest=nearest)
        violation = self.limits.violation(ordered[0].q)
        return NominalAnswer(IkVerdict.OUTSIDE_LIMITS, (), ordered, nearest=nearest, violation=violation)

    def _singularity(self, branches: Sequence[Branch]) -> str:
        """Names of the aligned axes, where a branch is one of a family."""
        free = {branch.free for branch in branches if branch.free is not None}
        if not free or self.form is None:
            return ""
        inner, outer, alone = ("1", "3", {6, 5}) if self.form["backwards"] else ("4", "6", {1, 2})
        three = "1, 2 and 3" if self.form["backwards"] else "4, 5 and 6"
        aligned = [f"the point where axes {three} meet lies on axis {joint}" for joint in sorted(free & alone)]
        if free - alone:
            aligned.append(f"axes {inner} and {outer} are in line")
        return "; ".join(aligned)


def poses_checked(positions: ArrayLike, rotations: ArrayLike) -> tuple[Array, Array]:
    """Checked positions (N, 3) and rotations (N, 3, 3). Raises `LrmError`."""
    p, R = np.asarray(positions, dtype=np.float64), np.asarray(rotations, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or R.shape != (len(p), 3, 3):
        raise LrmError(f"positions have shape {p.shape} and rotations {R.shape}; should be (N, 3) and (N, 3, 3)")
    finite = np.isfinite(p).all(axis=1) & np.isfinite(R).all(axis=(1, 2))
    if not finite.all():
        raise LrmError(f"goal {int(np.argmin(finite)) + 1}: position or rotation is not finite")
    return p, R
