"""Searches by damped least squares from many starts: for what has no closed form, and for what is nearest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.ik.answer import Answer, Branch, Limits, Nearest, Verdict, Violation
from lrm_math.ik.damped_least_squares import NominalArm, Targets, descend, jacobian, slide
from lrm_math.ik.goal import Goal, rotation_rows
from lrm_math.kinematics.chain import chain_of

FEW, MANY = 12, 84
"""Starts of a search: at first, and more before it is given up."""
ROUGH, EXACT = 25, 200
"""Steps towards what is nearest: of all starts, and of the best."""
TAKEN = 1e-10
"""Share of the arm's length by which joint angles that take a goal may miss it."""
SAME, ELSEWHERE, APART = 1e-6, 0.1, 0.5
"""rad: joint angles no further apart are one branch; no further apart, they represent one family; starts of slides."""
REPRESENTATIVES = 4
MOST_BEYOND = 8
"""Branches beyond the limits that are told."""
DEPENDENT, ALONG, LEFT = 1e-6, 0.02, 0.01
"""A family: smallest singular value over the arm's length; a step along it, and what of it must remain (rad)."""


@dataclass(frozen=True, eq=False)
class Search:
    """The nominal arm as a search sees it."""

    arm: NominalArm
    limits: Limits
    length: float

    @classmethod
    def of(cls, arm: Arm) -> Search:
        """For an arm."""
        chain = chain_of(arm)
        links = (s for s in chain.slots if not s.rotates and not s.place.startswith(("base", "link")))
        return cls(NominalArm.of(chain), Limits.of(arm), max(sum(abs(slot.nominal) for slot in links), 1e-3))

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
        """(count, n), angles spread evenly over the limits: multiples of irrational steps (Roberts 2018)."""
        n = len(self.limits.lower)
        golden = 2.0
        for _ in range(40):
            golden = (1.0 + golden) ** (1.0 / (n + 1))
        share = (0.5 + np.outer(np.arange(1, count + 1), golden ** -np.arange(1.0, n + 1.0))) % 1.0
        return np.asarray(self.lower + share * (self.upper - self.lower))

    def take(self, goal: Goal, starts: Array, limited: bool = True, steps: int = EXACT) -> Array:
        """(M, n), angles that take the goal, from those of the starts (K, n) that lead to it, limits kept or not."""
        open_end = np.full_like(self.lower, np.inf)
        lower, upper = (self.lower, self.upper) if limited else (-open_end, open_end)
        q, missing = descend(self.arm, self._targets(goal, len(starts)), starts, lower, upper, self.length, steps)
        return np.asarray(q[missing < TAKEN * self.length])

    def slide(self, goal: Goal, q: Array, towards: Array) -> Array:
        """(M, n), from angles (M, n) that take the goal, along what it leaves free, as near to `towards` as can be."""
        targets = self._targets(goal, len(q))
        moved, missing = slide(self.arm, targets, q, towards, self.lower, self.upper, self.length)
        nearer = np.square(moved - towards).sum(axis=1) < np.square(q - towards).sum(axis=1)
        return np.where((nearer & (missing < TAKEN * self.length))[:, None], moved, q)

    def nearest(self, goal: Goal, starts: Array) -> Nearest:
        """The reachable goal nearest to one that is not, from the starts (K, n) and others (see `damped`)."""
        starts = np.concatenate([starts, self.starts(FEW)])
        q, missing = self._descend(goal, starts, ROUGH)
        q, missing = self._descend(goal, q[np.argsort(missing)[:3]], EXACT)
        best = q[np.argmin(missing)]
        tool = self.arm.placed(best[None]).tcp[0, :3].T
        columns, tcp = tool[:3], tool[3]
        distance = float(np.linalg.norm(tcp - goal.position))
        angles = tuple(best.tolist())
        position = tuple(tcp.tolist())
        if goal.rotation is not None:
            chord = float(np.linalg.norm(columns.T - np.array(goal.rotation))) / 2**1.5
            return Nearest(
                angles, Goal(position, rotation_rows(columns.T)), distance, 2.0 * float(np.arcsin(min(1.0, chord)))
            )
        if goal.approach is not None:
            chord = float(np.linalg.norm(columns[2] - goal.approach)) / 2.0
            toward = tuple(columns[2].tolist())
            return Nearest(angles, Goal(position, None, toward), distance, 2.0 * float(np.arcsin(min(1.0, chord))))
        return Nearest(angles, Goal(position), distance, 0.0)

    def answer(self, goal: Goal, near: Array | None) -> Answer:
        """The answer to a goal of any kind.

        A goal that leaves some motion free is answered by the angles nearest to `near`, or to the limits' middle,
        in every family that was met: least squares of joint motions.
        """
        towards = self.middle if near is None else near
        if self._too_far(goal):
            return self.beyond(goal, towards, ())
        branches = self.branches(goal, near, MANY)
        if not branches:
            return self._failure(goal, towards)
        return answer_of(branches, near, "the joints' motions are dependent")

    def branches(self, goal: Goal, near: Array | None, more: int) -> tuple[Branch, ...]:
        """Of `answer`, within the limits; so many `more` starts if the first few lead nowhere or the goal is whole."""
        towards = self.middle if near is None else near
        determined = goal.constraints >= len(self.limits.lower)
        starts = np.vstack([np.clip(towards, self.lower, self.upper), self.starts(FEW)])
        found = self.take(goal, starts, steps=EXACT if determined else ROUGH)
        if more and (len(found) == 0 or determined):
            found = np.concatenate([found, self.take(goal, self.starts(FEW + more)[FEW:])])
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
        """Whether a position lies further from the first joint than the arm is long."""
        base = self.arm.placed(self.middle[None]).origin[0, :, 0]
        return float(np.linalg.norm(goal.position - base)) > self.length

    def _failure(self, goal: Goal, towards: Array) -> Answer:
        """Why a goal is not taken within the limits: taken beyond them, or not at all."""
        seeds = self.middle + np.pi * (2.0 * (self.starts(MANY) - self.lower) / (self.upper - self.lower) - 1.0)
        q = self.take(goal, seeds, limited=False)
        q = distinct(q + 2.0 * np.pi * np.rint((self.middle - q) / (2.0 * np.pi)), SAME)
        return self.beyond(goal, towards, tuple(Branch(tuple(row), -1, self.limits) for row in q.tolist()))

    def beyond(self, goal: Goal, towards: Array, branches: tuple[Branch, ...]) -> Answer:
        """The answer to a goal of which only branches that break limits are known, or none."""
        ordered = tuple(sorted(branches, key=MARGIN, reverse=True))[:MOST_BEYOND]
        starts = np.array([towards, *(branch.q for branch in ordered)])
        nearest = self.nearest(goal, starts)
        if not ordered:
            return Answer(Verdict.OUT_OF_REACH, (), nearest=nearest)
        margins = self.limits.margins(ordered[0].q)
        worst = min(range(len(margins)), key=margins.__getitem__)
        violation = Violation(worst + 1, -margins[worst])
        return Answer(Verdict.OUTSIDE_LIMITS, (), ordered, nearest=nearest, violation=violation)

    def _descend(self, goal: Goal, starts: Array, steps: int) -> tuple[Array, Array]:
        targets = self._targets(goal, len(starts))
        return descend(self.arm, targets, starts, self.lower, self.upper, self.length, steps)

    def _targets(self, goal: Goal, count: int) -> Targets:
        return Targets.of([goal], self.length).take(np.zeros(count, dtype=np.int64))

    def _free(self, goal: Goal, q: list[float]) -> int | None:
        """Number from 1 of a joint that may turn while the tool stays, others following."""
        targets = self._targets(goal, 1)
        here = np.array([q])
        J = jacobian(self.arm.placed(here), targets)[0]
        _, size, direction = np.linalg.svd(J)
        if size[-1] > DEPENDENT * self.length:
            return None
        for way in (ALONG, -ALONG):
            moved = self.take(goal, here + way * direction[-1])
            if len(moved) and np.abs(moved - here).max() > LEFT:
                return int(np.argmax(np.abs(direction[-1]))) + 1
        return None


MARGIN = attrgetter("margin")


def answer_of(branches: tuple[Branch, ...], near: Array | None, singularity: str) -> Answer:
    """The answer whose branches, all within the limits, are put in order."""
    if near is None:
        ordered = tuple(sorted(branches, key=MARGIN, reverse=True))
    else:
        here = tuple(near.tolist())
        ordered = tuple(sorted(branches, key=lambda branch: branch.distance(here)))
    if any(branch.free is not None for branch in ordered):
        return Answer(Verdict.SINGULAR, ordered, singularity=singularity)
    return Answer(Verdict.SOLVED, ordered)


def by_distance(q: Array, towards: Array) -> Array:
    """The rows of (K, n), nearest to the angles `towards` first."""
    return np.asarray(q[np.argsort(np.square(q - towards).sum(axis=1))])


def distinct(q: Array, apart: float) -> Array:
    """(M, n), those rows of (K, n) that are further than `apart` (rad) from all before them, whole turns aside."""
    kept: list[Array] = []
    for row in q:
        if all(np.abs((row - other + np.pi) % (2.0 * np.pi) - np.pi).max() > apart for other in kept):
            kept.append(row)
    return np.array(kept).reshape(len(kept), q.shape[1])
