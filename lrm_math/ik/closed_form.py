"""Inverse of arms whose first or last three axes intersect: all branches of a pose in closed form (Pieper 1968)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.ik.answer import Branch, IkVerdict, JointLimits, NominalAnswer
from lrm_math.ik.batch_closed_form import TURN, AllBranches, AngleWindow, all_branches
from lrm_math.ik.damped_least_squares import TargetBatch, descend
from lrm_math.ik.free_roll import BEYOND, RollSweep, least_motion_rolls
from lrm_math.ik.goal import Goal
from lrm_math.ik.multi_start import ELSEWHERE, REPRESENTATIVES, SAME, TAKEN, MultiStart, answer_of, distinct, separated
from lrm_math.ik.pieper import PieperForm, pieper_form
from lrm_math.ik.scalar_closed_form import ROUND_OFF, ScalarClosedForm, scalar_closed_form
from lrm_math.ik.screw_axes import screw_axes_of
from lrm_math.ik.solver import BatchAnswer, Mask, NominalSolver, angles_near, poses_checked

SWEEP = 73
"""Samples of a free angle over its range, at first and once more around the best."""
ROUGHLY, EXACTLY = 0.01, 3e-5
"""rad: resolution of the roll about an approach direction, for seeds and for answers."""


@dataclass(frozen=True, eq=False)
class ClosedForm(NominalSolver):
    """Poses by `scalar_closed_form`, degenerate ones by `batch_closed_form`.

    An approach goal is solved from poses of any roll, a position from a multi-start search; of the solutions those
    nearest to `near`, or to the middle of the limits, are answered.
    """

    arm: Arm
    form: PieperForm
    limits: JointLimits
    search: MultiStart
    scalar_solver: ScalarClosedForm | None
    multi_turn: bool
    anywhere: AngleWindow
    inside: AngleWindow

    @classmethod
    def of(cls, arm: Arm) -> ClosedForm | None:
        """For an arm of six joints whose first or last three axes intersect; None for any other."""
        form = pieper_form(screw_axes_of(arm))
        if form is None:
            return None
        limits = JointLimits.of(arm)
        multi_turn = any(b - a > 2.0 * np.pi for a, b in zip(limits.lower, limits.upper, strict=True))
        search = MultiStart.of(arm)
        anywhere, inside = (
            AngleWindow.of(form, search.lower, search.upper, limited) for limited in (False, not multi_turn)
        )
        return cls(arm, form, limits, search, scalar_closed_form(form, limits), multi_turn, anywhere, inside)

    def solve(self, goal: Goal, near: Sequence[float] | None = None) -> NominalAnswer:
        here = None if near is None else angles_near(near, 6)
        if goal.rotation is None:
            answer = None if goal.approach is None else self._solve_approach(goal, here, EXACTLY)
            return self.search.answer(goal, here) if answer is None else answer
        if self.scalar_solver is None or self.multi_turn:
            return self._solve_degenerate(goal, here)
        found = self.scalar_solver(goal.rotation, goal.position)
        if not found:
            return self._solve_degenerate(goal, here)
        limits = self.limits
        branches = tuple([Branch(q, number, limits) for number, q in found])
        return NominalAnswer(IkVerdict.SOLVED, branches) if len(branches) == 1 else answer_of(branches, here, "")

    def partial_branches(self, goal: Goal, near: Sequence[float] | None = None) -> tuple[Branch, ...]:
        here = None if near is None else angles_near(near, 6)
        found = None if goal.approach is None else self._solve_approach(goal, here, ROUGHLY)
        return self.search.branches(goal, here, 0) if found is None else found.branches

    def solve_batch(self, positions: ArrayLike, rotations: ArrayLike) -> BatchAnswer:
        p, R = poses_checked(positions, rotations)
        found = self._branches(p, R, self.search.middle, self.inside)
        q, kept = self._limited(found, self.search.middle) if self.multi_turn else (found.q, found.exists)
        return BatchAnswer(q, kept, found.free >= 0)

    def _branches(self, positions: Array, rotations: Array, at: Array, window: AngleWindow) -> AllBranches:
        """Every branch in a window, ill-conditioned ones refined by damped least squares."""
        found = all_branches(self.form, positions, rotations, at, window)
        goal, number = np.nonzero(found.ill_conditioned)
        if len(goal):
            targets = TargetBatch.poses(positions[goal], rotations[goal], self.search.length)
            order = slice(None, None, -1) if self.form.backwards else slice(None)
            q, found.exists[goal, number] = self._refined(
                targets, found.q[goal, number], window.lower[order], window.upper[order]
            )
            found.q[goal, number] = q
        return found

    def _refined(self, targets: TargetBatch, q: Array, lower: Array, upper: Array) -> tuple[Array, Mask]:
        """Angles (K, 6) close to their goals, refined, and whether they converge."""
        q, missing = descend(self.search.arm, targets, q, lower, upper, self.search.length)
        return q, missing < TAKEN * self.search.length

    def _limited(self, found: AllBranches, towards: Array) -> tuple[Array, Mask]:
        """The branches modulo 2π as near to the angles `towards` as the limits let, and which keep the limits."""
        lower, upper, q = self.search.lower, self.search.upper, found.q
        if self.multi_turn:
            q = q + TURN * np.rint((towards - q) / TURN)
            q = q + TURN * np.ceil((lower - ROUND_OFF - q) / TURN).clip(min=0.0)
            q = q - TURN * np.ceil((q - upper - ROUND_OFF) / TURN).clip(min=0.0)
        inside = found.exists & ((q >= lower - ROUND_OFF) & (q <= upper + ROUND_OFF)).all(axis=2)
        return np.where(inside[..., None], np.clip(q, lower, upper), q), inside

    def _solve_degenerate(self, goal: Goal, near: Array | None) -> NominalAnswer:
        """A pose at the edge of the workspace, singular, outside the limits or out of reach."""
        towards = self.search.middle if near is None else near
        p, R = np.array([goal.position]), np.array([goal.rotation])
        found = self._branches(p, R, towards, self.anywhere)
        q, inside = self._limited(found, towards)
        branches: list[Branch] = []
        beyond: list[Branch] = []
        for number in separated(q[0], np.flatnonzero(found.exists[0]), SAME):
            free = int(found.free[0, number])
            angles, kept = q[0, number], bool(inside[0, number])
            if free >= 0:
                angles, kept = self._family_member(goal, number, free, towards)
                window = self.search if kept else self.anywhere
                targets = TargetBatch.poses(p, R, self.search.length)
                refined, exact = self._refined(targets, angles[None], window.lower, window.upper)
                if not exact[0]:
                    continue
                angles = refined[0]
            branch = Branch(tuple(angles.tolist()), number, self.limits, None if free < 0 else free + 1)
            (branches if kept else beyond).append(branch)
        if not branches:
            return self.search.beyond(goal, towards, tuple(beyond))
        return answer_of(tuple(branches), near, self._singularity(branches))

    def _family_member(self, goal: Goal, number: int, free: int, towards: Array) -> tuple[Array, bool]:
        """A member of the family in which joint number `free` rolls, within the limits if possible (rad)."""
        low, high = self.search.lower[free], self.search.upper[free]
        samples = np.append(np.linspace(low, high, SWEEP), np.clip(towards[free], low, high))
        for _ in range(2):
            at = np.tile(towards, (len(samples), 1))
            at[:, free] = samples
            p, R = (np.repeat(np.array([v]), len(samples), axis=0) for v in (goal.position, goal.rotation))
            found = all_branches(self.form, p, R, at, self.anywhere)
            q, inside = self._limited(found, towards)
            q, inside, exists = q[:, number], inside[:, number], found.exists[:, number]
            margin = np.minimum(q - self.search.lower, self.search.upper - q).min(axis=1)
            if inside.any():
                wish = margin if towards is self.search.middle else -np.square(q - towards).sum(axis=1)
                return q[np.argmax(np.where(inside, wish, -np.inf))], True
            best = int(np.argmax(np.where(exists, margin, -np.inf)))
            step = (high - low) / (SWEEP - 1)
            samples = np.clip(np.linspace(samples[best] - step, samples[best] + step, SWEEP), low, high)
        return q[int(np.argmax(np.where(exists, margin, -np.inf)))], False

    def _singularity(self, branches: list[Branch]) -> str:
        """Which axes are aligned, where a branch is one of a family."""
        free = {branch.free for branch in branches if branch.free is not None}
        inner, outer, alone = ("1", "3", {6, 5}) if self.form.backwards else ("4", "6", {1, 2})
        three = "1, 2 and 3" if self.form.backwards else "4, 5 and 6"
        aligned = [f"the point where axes {three} meet lies on axis {joint}" for joint in sorted(free & alone)]
        if free - alone:
            aligned.append(f"axes {inner} and {outer} are in line")
        return "; ".join(aligned)

    def _solve_approach(self, goal: Goal, near: Array | None, finest: float) -> NominalAnswer | None:
        """A position with an approach; None if no roll was found that leads there."""
        towards = self.search.middle if near is None else near
        z, now = np.array(goal.approach), self.search.arm.forward(towards[None]).tcp[0, :3].T
        x = np.cross(now[1], z) if abs(z @ now[1]) < 0.9 else np.cross(now[0], z)
        x /= np.linalg.norm(x)
        axes = np.array([x, np.cross(z, x), z])
        found = least_motion_rolls(lambda rolls: self._roll_branches(goal, axes, rolls, towards), finest)
        if len(found) == 0:
            return None
        found = distinct(found, ELSEWHERE)[:REPRESENTATIVES]
        return answer_of(tuple(Branch(tuple(row), -1, self.limits) for row in found.tolist()), near, "")

    def _roll_branches(self, goal: Goal, axes: Array, rolls: Array, towards: Array) -> RollSweep:
        """The branches for rolls (K,) of the tool with axes (3, 3) about its z."""
        c, s, (x, y, z) = np.cos(rolls)[:, None], np.sin(rolls)[:, None], axes
        R = np.stack([c * x + s * y, c * y - s * x, np.broadcast_to(z, (len(rolls), 3))], axis=2)
        found = self._branches(np.tile(goal.position, (len(rolls), 1)), R, towards, self.anywhere)
        q, inside = self._limited(found, towards)
        beyond = np.maximum(self.search.lower - q, q - self.search.upper).clip(min=0.0).max(axis=2)
        cost = np.where(inside, np.square(q - towards).sum(axis=2), BEYOND * (1.0 + beyond))
        return RollSweep(q, found.exists, np.where(found.exists, cost, np.inf))
