"""Answers of nominal inverse kinematics: all branches, or the reason why there are none and the nearest goal."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from lrm_math.arm.joint_limits import JointLimits, Violation
from lrm_math.arrays import Array
from lrm_math.ik.goal import CHAR_LENGTH, Goal, rotation_rows


class IkVerdict(StrEnum):
    """Outcome of a goal."""

    SOLVED = "solved"
    SINGULAR = "singular"
    """Solved, but some branch is one of a continuous family, so that the list of branches is incomplete."""
    OUTSIDE_LIMITS = "outside_limits"
    """Solvable only outside the joint limits."""
    OUT_OF_REACH = "out_of_reach"
    """No joint angles solve the goal, limits or not."""


class Branch(NamedTuple):
    """One solution of a goal; a tuple, as a search makes thousands.

    Attributes:
        q: joint angles (rad), within the limits unless the verdict is outside_limits.
        margin: distance to the nearest joint limit (rad); negative outside.
        number: branch of the closed form, 0 to 7 (see `label`), or -1 where there are no fixed branches.
        free: number from 1 of a joint that can turn while the tool stays, others following; None if there is none.
    """

    q: tuple[float, ...]
    margin: float
    number: int = -1
    free: int | None = None

    @property
    def label(self) -> str:
        """Signs of the three roots of the closed form, e.g. `+-+`; empty where there are none.

        In the order in which they are taken: for an arm whose last three axes intersect elbow, shoulder, wrist; for one
        whose first three do, the same seen from the tool.
        """
        return "" if self.number < 0 else "".join("-" if self.number & bit else "+" for bit in (4, 2, 1))

    def distance(self, q: tuple[float, ...]) -> float:
        """Euclidean distance to q in joint space (rad)."""
        return math.dist(self.q, q)


def branch_at(q: tuple[float, ...], limits: JointLimits, free: int | None = None) -> Branch:
    """A branch that has no number."""
    return Branch(q, min(limits.margins(q)), free=free)


@dataclass(frozen=True, slots=True)
class Nearest:
    """The reachable goal nearest to an unreachable one.

    Attributes:
        q: its joint angles, within the limits (rad).
        goal: of the same kind as the query, reached by q.
        distance: from the queried position (m).
        angle: from the queried orientation or approach (rad); 0 for a position alone.
    """

    q: tuple[float, ...]
    goal: Goal
    distance: float
    angle: float

    @property
    def error(self) -> float:
        """m, rotation included."""
        return math.hypot(self.distance, CHAR_LENGTH * self.angle)

    @classmethod
    def at(cls, q: tuple[float, ...], goal: Goal, tcp: Array) -> Nearest:
        """Of joint angles q (rad) that take the tool to a frame (4, 4)."""
        reached, angle = goal.same_kind_at(tcp), goal.angle_from(rotation_rows(tcp[:3, :3]))
        return cls(q, reached, math.dist(goal.position, reached.position), angle)


@dataclass(frozen=True, slots=True)
class NominalAnswer:
    """The answer to one goal.

    Attributes:
        branches: solutions within the limits, best first: nearest to `near`, else furthest from the limits. Empty
            unless solved or singular.
        beyond: solutions that break limits, the least excess first; only where there are no others.
        singularity: which axes are aligned, or empty.
        nearest: for a goal that has no solution.
        violation: for a goal that the limits forbid.
    """

    verdict: IkVerdict
    branches: tuple[Branch, ...]
    beyond: tuple[Branch, ...] = ()
    singularity: str = ""
    nearest: Nearest | None = None
    violation: Violation | None = None

    @property
    def solved(self) -> bool:
        """Whether there is a branch within the limits."""
        return bool(self.branches)

    def __len__(self) -> int:
        return len(self.branches)

    def __iter__(self) -> Iterator[Branch]:
        return iter(self.branches)

    def __str__(self) -> str:
        lines = [self._headline()]
        lines += [_line(branch) for branch in self.branches]
        return "\n".join(lines)

    def _headline(self) -> str:
        count = f"{len(self.branches)} branch{'' if len(self.branches) == 1 else 'es'}"
        if self.verdict is IkVerdict.SOLVED:
            return f"solved: {count}"
        if self.verdict is IkVerdict.SINGULAR:
            return f"singular: {self.singularity}; {count}, of families"
        why = "out of reach" if self.violation is None else str(self.violation)
        if self.nearest is None:
            return why
        turn = f" and {math.degrees(self.nearest.angle):.2f} deg" if self.nearest.goal.constraints > 3 else ""
        return f"{why}; the nearest reachable goal is {1e3 * self.nearest.distance:.2f} mm{turn} away"


def _line(branch: Branch) -> str:
    angles = " ".join(f"{math.degrees(x):8.2f}" for x in branch.q)
    free = f", joint {branch.free} may turn" if branch.free is not None else ""
    return f"  {branch.label:>3} {angles} deg, {math.degrees(branch.margin):.1f} deg from the nearest limit{free}"
