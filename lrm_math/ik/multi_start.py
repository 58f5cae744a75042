"""Multi-start damped least squares: for arms without a closed form, and for the nearest reachable goal."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.ik.answer import Branch, IkVerdict, JointLimits, Nearest, NominalAnswer
from lrm_math.ik.damped_least_squares import NominalArm, TargetBatch, descend, jacobian, slide
from lrm_math.ik.goal import Goal
from lrm_math.ik.linkage import Indices
from lrm_math.kinematics.chain import chain_of

FEW, MANY = 12, 84
"""Starts of a search: at first, and more before it is given up."""
ROUGH, EXACT = 25, 200
"""Steps of a descent: from all starts, and from the best."""
TAKEN = 1e-10
"""Share of the arm's length by which joint angles that solve a goal may miss it."""
SAME, ELSEWHERE, APART = 1e-6, 0.1, 0.5
"""rad: joint angles no further apart are one branch; no further apart, they represent one family; starts of slides."""
REPRESENTATIVES = 4
MOST_BEYOND = 8
"""Number of branches beyond the limits in an answer."""
DEPENDENT, ALONG, LEFT = 1e-6, 0.02, 0.01
"""A family: smallest singular value over the arm's length; a step along it, and what of it must remain (rad)."""


@dataclass(frozen=True, eq=False)
class MultiStart:
    """Search on the nominal arm; `length`: of the stretched arm (m)."""

    arm: NominalArm
    limits: JointLimits
    length: float

    @classmethod
    def of(cls, arm: Arm) -> MultiStart:
        """For an arm."""
        chain = chain_of(arm)
        links = (s for s in chain.slots if not s.rotates and not s.place.startswith(("base", "link")))
        return cls(NominalArm.of(chain), JointLimits.of(arm), max(sum(abs(slot.nominal) for slot in links), 1e-3))

    @cached_property
    def lower(self) -> Array:
        """(n,), rad."""
        return np.array(self.limits.lower)

    @cached_property
    def upper(self) -> Array:
        """(n,), rad."""
        return np.array(self.limits.upper)

    @cached_property
    def middle(self) -> Array:
        """(n,), rad."""
        return np.array(self.limits.middle)

    def starts(self, count: int) -> Array:
        """(count, n), angles spread evenly over the limits."""
        share = roberts_sequence(count, len(self.limits.lower))
        return np.asarray(self.lower + share * (self.upper - self.lower))

    def solve_from(self, goal: Goal, starts: Array, limited: bool = True, steps: int = EXACT) -> Array:
        """(M, n), angles that solve the goal, from those of the starts (K, n) that lead to it, limits kept or not."""
        open_end = np.full_like(self.lower, np.inf)
        lower, upper = (self.lower, self.upper) if limited else (-open_end, open_end)
        q, missing = descend(self.arm, self._targets(goal, len(starts)), starts, lower, upper, self.length, steps)
        return np.asarray(q[missing < TAKEN * self.length])

    def slide(self, goal: Goal, q: Array, towards: Array) -> Array:
        """(M, n), solutions (M, n) moved along what the goal leaves free, as near to `towards` as possible."""
        targets = self._targets(goal, len(q))
        moved, missing = slide(self.arm, targets, q, towards, self.lower, self.upper, self.length)
        nearer = np.square(moved - towards).sum(axis=1) < np.square(q - towards).sum(axis=1)
        return np.where((nearer & (missing < TAKEN * self.length))[:, None], moved, q)

    def nearest(self, goal: Goal, starts: Array) -> Nearest:
        """The reachable goal nearest to an unreachable one, from the starts (K, n) and others."""
        starts = np.concatenate([starts, self.starts(FEW)])
        q, missing = self._descend(goal, starts, ROUGH)
        q, missing = self._descend(goal, q[np.argsort(missing)[:3]], EXACT)
        best = q[np.argmin(missing)]
        tcp, chord = self.arm.forward(best[None]).tcp[0], 0.0
        distance = float(np.linalg.norm(tcp[:3, 3] - goal.position))
        if goal.rotation is not None:
            chord = float(np.linalg.norm(tcp[:3, :3] - np.array(goal.rotation))) / 2**1.5
        elif goal.approach is not None:
            chord = float(np.linalg.norm(tcp[:3, 2] - goal.approach)) / 2.0
        angle = 2.0 * float(np.arcsin(min(1.0, chord)))
        return Nearest(tuple(best.tolist()), goal.same_kind_at(tcp), distance, angle)

    def answer(self, goal: Goal, near: Array | None) -> NominalAnswer:
        """The answer to a goal of any kind.

        A goal that leaves some motion free is answered by the angles nearest to `near`, or to the middle of the limits,
        in every family found: least squares of joint motions.
        """
        towards = self.middle if near is None else near
        if self._too_far(goal):
            return self.beyond(goal, towards, ())
        branches = self.branches(goal, near, MANY)
        if not branches:
            return self._failure(goal, towards)
        return answer_of(branches, near, "the joints' motions are dependent")

    def branches(self, goal: Goal, near: Array | None, more: int) -> tuple[Branch, ...]:
        """Those of `answer`, within the limits; `more` starts if the first lead nowhere or the goal is determined."""
        towards = self.middle if near is None else near
        determined = goal.constraints >= len(self.limits.lower)
        starts = np.vstack([np.clip(towards, self.lower, self.upper), self.starts(FEW)])
        found = self.solve_from(goal, starts, steps=EXACT if determined else ROUGH)
        if more and (len(found) == 0 or determined):
            found = np.concatenate([found, self.solve_from(goal, self.starts(FEW + more)[FEW:])])
        if len(found) == 0:
            return ()
        found = by_distance(found, towards)
        if not determined:
            found = by_distance(self.slide(goal, distinct(found, APART)[:REPRESENTATIVES], towards), towards)
        return tuple(
            Branch(tuple(row), -1, self.limits, self._free(goal, row) if determined else None)
            for row in distinct(found, SAME if determined else ELSEWHERE).tolist()
        )

    def _too_far(self, goal: Goal) -> bool:
        """Whether a position is further from the first joint than the arm is long."""
        base = self.arm.forward(self.middle[None]).origin[0, :, 0]
        return float(np.linalg.norm(goal.position - base)) > self.length

    def _failure(self, goal: Goal, towards: Array) -> NominalAnswer:
        """Why a goal has no solution within the limits: solved beyond them, or not at all."""
        seeds = self.middle + np.pi * (2.0 * (self.starts(MANY) - self.lower) / (self.upper - self.lower) - 1.0)
        q = self.solve_from(goal, seeds, limited=False)
        q = distinct(q + 2.0 * np.pi * np.rint((self.middle - q) / (2.0 * np.pi)), SAME)
        return self.beyond(goal, towards, tuple(Branch(tuple(row), -1, self.limits) for row in q.tolist()))

    def beyond(self, goal: Goal, towards: Array, branches: tuple[Branch, ...]) -> NominalAnswer:
        """The answer to a goal of which only branches that break limits are known, or none."""
        ordered = tuple(sorted(branches, key=MARGIN, reverse=True))[:MOST_BEYOND]
        starts = np.array([towards, *(branch.q for branch in ordered)])
        nearest = self.nearest(goal, starts)
        if not ordered:
            return NominalAnswer(IkVerdict.OUT_OF_REACH, (), nearest=nearest)
        violation = self.limits.violation(ordered[0].q)
        return NominalAnswer(IkVerdict.OUTSIDE_LIMITS, (), ordered, nearest=nearest, violation=violation)

    def _descend(self, goal: Goal, starts: Array, steps: int) -> tuple[Array, Array]:
        targets = self._targets(goal, len(starts))
        return descend(self.arm, targets, starts, self.lower, self.upper, self.length, steps)

    def _targets(self, goal: Goal, count: int) -> TargetBatch:
        return TargetBatch.of([goal], self.length).take(np.zeros(count, dtype=np.int64))

    def _free(self, goal: Goal, q: list[float]) -> int | None:
        """Number from 1 of a joint that can turn while the tool stays (self-motion); None if there is none."""
        targets = self._targets(goal, 1)
        here = np.array([q])
        J = jacobian(self.arm.forward(here), targets)[0]
        _, size, direction = np.linalg.svd(J)
        if size[-1] > DEPENDENT * self.length:
            return None
        for sign in (ALONG, -ALONG):
            moved = self.solve_from(goal, here + sign * direction[-1])
            if len(moved) and np.abs(moved - here).max() > LEFT:
                return int(np.argmax(np.abs(direction[-1]))) + 1
        return None


MARGIN = attrgetter("margin")


def answer_of(branches: tuple[Branch, ...], near: Array | None, singularity: str) -> NominalAnswer:
    """The answer with branches within the limits, in order."""
    if near is None:
        ordered = tuple(sorted(branches, key=MARGIN, reverse=True))
    else:
        here = tuple(near.tolist())
        ordered = tuple(sorted(branches, key=lambda branch: branch.distance(here)))
    if any(branch.free is not None for branch in ordered):
        return NominalAnswer(IkVerdict.SINGULAR, ordered, singularity=singularity)
    return NominalAnswer(IkVerdict.SOLVED, ordered)


def roberts_sequence(count: int, n: int) -> Array:
    """(count, n), evenly over the unit cube: additive sequence with irrational steps (Roberts 2018)."""
    golden = 2.0
    for _ in range(40):
        golden = (1.0 + golden) ** (1.0 / (n + 1))
    return (0.5 + np.outer(np.arange(1, count + 1), golden ** -np.arange(1.0, n + 1.0))) % 1.0


def separated(q: Array, rows: Indices, apart: float) -> list[int]:
    """Those rows of q (K, n), in the order given, that are further than `apart` (rad) from all before them."""
    kept: list[int] = []
    for row in rows.tolist():
        if all(np.abs(q[row] - q[other]).max() > apart for other in kept):
            kept.append(row)
    return kept


def by_distance(q: Array, towards: Array) -> Array:
    """The rows of (K, n), nearest to the angles `towards` first."""
    return np.asarray(q[np.argsort(np.square(q - towards).sum(axis=1))])


def distinct(q: Array, apart: float) -> Array:
    """(M, n), the rows of (K, n) that are further than `apart` (rad) from all before them, modulo 2π."""
    kept: list[Array] = []
    for row in q:
        if all(np.abs((row - other + np.pi) % (2.0 * np.pi) - np.pi).max() > apart for other in kept):
            kept.append(row)
    return np.array(kept).reshape(len(kept), q.shape[1])
