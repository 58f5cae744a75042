"""Arms whose first or last three axes meet: all branches of a pose in closed form (Pieper 1968)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.ik.answer import Answer, Branch, Limits, Verdict
from lrm_math.ik.batch_closed_form import TURN, AllBranches, Mask, Window, all_branches
from lrm_math.ik.damped_least_squares import Targets, descend
from lrm_math.ik.free_roll import BEYOND, Around, least
from lrm_math.ik.goal import Goal
from lrm_math.ik.multi_start import ELSEWHERE, REPRESENTATIVES, SAME, TAKEN, Search, answer_of, distinct
from lrm_math.ik.pieper import Pieper, pieper_form
from lrm_math.ik.scalar_closed_form import ROUND_OFF, OneGoal, one_goal_solver
from lrm_math.ik.screw_axes import lines_of
from lrm_math.ik.solver import BatchAnswer, NominalSolver, angles_near, poses_checked

SWEEP = 73
"""Samples of a free angle over its range, at first and once more around the best."""
ROUGHLY, EXACTLY = 0.01, 3e-5
"""rad: how finely turns about an approach direction are told, for seeds and for answers."""


@dataclass(frozen=True, eq=False)
class ClosedForm(NominalSolver):
    """Poses by `one_goal`, and what that leaves aside by `many_goals`.

    A goal whose tool direction is given is answered from poses all round that direction, one with a position alone
    from a search; of both the joint angles nearest to `near`, or to the middle of the limits.
    """

    arm: Arm
    form: Pieper
    limits: Limits
    search: Search
    one_goal: OneGoal | None
    wide: bool
    anywhere: Window
    inside: Window

    @classmethod
    def of(cls, arm: Arm) -> ClosedForm | None:
        """For an arm of six joints whose first or last three axes meet; None for any other."""
        form = pieper_form(lines_of(arm))
        if form is None:
            return None
        limits = Limits.of(arm)
        wide = any(b - a > 2.0 * np.pi for a, b in zip(limits.lower, limits.upper, strict=True))
        search = Search.of(arm)
        anywhere, inside = (Window.of(form, search.lower, search.upper, limited) for limited in (False, not wide))
        return cls(arm, form, limits, search, one_goal_solver(form, limits), wide, anywhere, inside)

    def solve(self, goal: Goal, near: Sequence[float] | None = None) -> Answer:
        here = None if near is None else angles_near(near, 6)
        if goal.rotation is None:
            return self._lesser(goal, here)
        if self.one_goal is None or self.wide:
            return self._careful(goal, here)
        found = self.one_goal(goal.rotation, goal.position)
        if not found:
            return self._careful(goal, here)
        limits = self.limits
        branches = tuple([Branch(q, number, limits) for number, q in found])
        return Answer(Verdict.SOLVED, branches) if len(branches) == 1 else answer_of(branches, here, "")

    def lesser(self, goal: Goal, near: Sequence[float] | None = None) -> tuple[Branch, ...]:
        here = None if near is None else angles_near(near, 6)
        found = None if goal.approach is None else self._along(goal, here, ROUGHLY)
        return self.search.branches(goal, here, 0) if found is None else found.branches

    def solve_batch(self, positions: ArrayLike, rotations: ArrayLike) -> BatchAnswer:
        p, R = poses_checked(positions, rotations)
        found = self._branches(p, R, self.search.middle, self.inside)
        q, kept = self._limited(found, self.search.middle) if self.wide else (found.q, found.exists)
        return BatchAnswer(q, kept, found.free >= 0)

    def _branches(self, positions: Array, rotations: Array, at: Array, window: Window) -> AllBranches:
        """Every branch in a window, delicate ones put right by Newton's method."""
        found = all_branches(self.form, positions, rotations, at, window)
        goal, number = np.nonzero(found.delicate)
        if len(goal):
            targets = Targets.poses(positions[goal], rotations[goal], self.search.length)
            order = slice(None, None, -1) if self.form.backwards else slice(None)
            q, found.exists[goal, number] = self._settled(
                targets, found.q[goal, number], window.lower[order], window.upper[order]
            )
            found.q[goal, number] = q
        return found

    def _settled(self, targets: Targets, q: Array, lower: Array, upper: Array) -> tuple[Array, Mask]:
        """Angles (K, 6) that all but take their goals, made to, and whether they do."""
        q, missing = descend(self.search.arm, targets, q, lower, upper, self.search.length)
        return q, missing < TAKEN * self.search.length

    def _limited(self, found: AllBranches, towards: Array) -> tuple[Array, Mask]:
        """The branches by whole turns as near to the angles `towards` as the limits let, and which keep the limits."""
        lower, upper, q = self.search.lower, self.search.upper, found.q
        if self.wide:
            q = q + TURN * np.rint((towards - q) / TURN)
            q = q + TURN * np.ceil((lower - ROUND_OFF - q) / TURN).clip(min=0.0)
            q = q - TURN * np.ceil((q - upper - ROUND_OFF) / TURN).clip(min=0.0)
        inside = found.exists & ((q >= lower - ROUND_OFF) & (q <= upper + ROUND_OFF)).all(axis=2)
        return np.where(inside[..., None], np.clip(q, lower, upper), q), inside

    def _careful(self, goal: Goal, near: Array | None) -> Answer:
        """A pose that the fast path left aside: at the edge of reach, singular, outside the limits or out of reach."""
        towards = self.search.middle if near is None else near
        p, R = np.array([goal.position]), np.array([goal.rotation])
        found = self._branches(p, R, towards, self.anywhere)
        q, inside = self._limited(found, towards)
        branches: list[Branch] = []
        beyond: list[Branch] = []
        for number in self._unlike(q[0], found.exists[0]):
            free = int(found.free[0, number])
            angles, kept = q[0, number], bool(inside[0, number])
            if free >= 0:
                angles, kept = self._swept(goal, number, free, towards)
                window = self.search if kept else self.anywhere
                targets = Targets.poses(p, R, self.search.length)
                settled, exact = self._settled(targets, angles[None], window.lower, window.upper)
                if not exact[0]:
                    continue
                angles = settled[0]
            branch = Branch(tuple(angles.tolist()), number, self.limits, None if free < 0 else free + 1)
            (branches if kept else beyond).append(branch)
        if not branches:
            return self.search.beyond(goal, towards, tuple(beyond))
        return answer_of(tuple(branches), near, self._singularity(branches))

    def _unlike(self, q: Array, exists: Mask) -> list[int]:
        """Numbers of the branches (8, 6) without those that double others, as they do at the edge of reach."""
        kept: list[int] = []
        for number in np.flatnonzero(exists).tolist():
            if all(np.abs(q[number] - q[other]).max() > SAME for other in kept):
                kept.append(number)
        return kept

    def _swept(self, goal: Goal, number: int, free: int, towards: Array) -> tuple[Array, bool]:
        """A member within the limits, if there is any, of the family in which joint number `free` turns (rad)."""
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
        """Which axes are in line, where a branch is one of a family."""
        free = {branch.free for branch in branches if branch.free is not None}
        inner, outer, alone = ("1", "3", {6, 5}) if self.form.backwards else ("4", "6", {1, 2})
        three = "1, 2 and 3" if self.form.backwards else "4, 5 and 6"
        said = [f"the point where axes {three} meet lies on axis {joint}" for joint in sorted(free & alone)]
        if free - alone:
            said.append(f"axes {inner} and {outer} are in line")
        return "; ".join(said)

    def _lesser(self, goal: Goal, near: Array | None) -> Answer:
        """A goal without a full orientation: a position from a search, with an approach from poses all round it."""
        found = None if goal.approach is None else self._along(goal, near, EXACTLY)
        return self.search.answer(goal, near) if found is None else found

    def _along(self, goal: Goal, near: Array | None, finest: float) -> Answer | None:
        """A position with an approach; None if no turn about it was found that leads there."""
        towards = self.search.middle if near is None else near
        z, now = np.array(goal.approach), self.search.arm.placed(towards[None]).tcp[0, :3].T
        x = np.cross(now[1], z) if abs(z @ now[1]) < 0.9 else np.cross(now[0], z)
        x /= np.linalg.norm(x)
        axes = np.array([x, np.cross(z, x), z])
        found = least(lambda turns: self._around(goal, axes, turns, towards), finest)
        if len(found) == 0:
            return None
        found = distinct(found, ELSEWHERE)[:REPRESENTATIVES]
        return answer_of(tuple(Branch(tuple(row), -1, self.limits) for row in found.tolist()), near, "")

    def _around(self, goal: Goal, axes: Array, turns: Array, towards: Array) -> Around:
        """The branches for turns (K,) of the tool with axes (3, 3) about its z."""
        c, s, (x, y, z) = np.cos(turns)[:, None], np.sin(turns)[:, None], axes
        R = np.stack([c * x + s * y, c * y - s * x, np.broadcast_to(z, (len(turns), 3))], axis=2)
        found = self._branches(np.tile(goal.position, (len(turns), 1)), R, towards, self.anywhere)
        q, inside = self._limited(found, towards)
        beyond = np.maximum(self.search.lower - q, q - self.search.upper).clip(min=0.0).max(axis=2)
        bad = np.where(inside, np.square(q - towards).sum(axis=2), BEYOND * (1.0 + beyond))
        return Around(q, found.exists, np.where(found.exists, bad, np.inf))
