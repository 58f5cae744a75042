"""Answers of inverse kinematics, nominal and calibrated: all branches, or why there are none and the nearest goal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar, NamedTuple, TypeAlias

from lrm_math.arm.arm import Violation
from lrm_math.arm.pulse_rounding import RoundedCommand
from lrm_math.arrays import Array, Vector3
from lrm_math.ik.goal import CHAR_LENGTH, Friction, Goal, Rotation, rotation_rows
from lrm_math.model.uncertainty import PositionUncertainty


class Branch(NamedTuple):
    """One solution of a goal; a tuple, as a search makes thousands.

    Attributes:
        q: joint angles (rad), commanded ones of a calibrated arm; within the limits unless the verdict is
            outside_limits.
        margin: distance to the nearest joint limit (rad); negative outside.
        number: branch of the closed form, 0 to 7 (see `label`), or -1 where there are no fixed branches.
        free: number from 1 of a joint that can turn while the tool stays, others following; None if there is none.
        direction: of a calibrated arm, the side that each joint arrives from (see `Poses`), zeros where not known.
        detours: joints from 1 that a move straight from `near` would bring from the other side.
        slots: amounts of the moving slots in equilibrium (rad, m).
        friction: of a calibrated arm with effects that the kernel has no formula for, its states on arrival.
    """

    q: tuple[float, ...]
    margin: float
    number: int = -1
    free: int | None = None
    direction: tuple[int, ...] = ()
    detours: tuple[int, ...] = ()
    slots: tuple[float, ...] = ()
    friction: Friction = ()

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


SAME = 1e-6
"""rad: commands no further apart are one."""


def apart(q: Sequence[float], other: Sequence[float]) -> float:
    """Largest difference of a joint (rad)."""
    return max([abs(a - b) for a, b in zip(q, other, strict=True)])


def distinct(commands: Iterable[Branch], least: float = SAME) -> list[Branch]:
    """Commands without those of which no joint is more than `least` (rad) from one before."""
    kept: list[Branch] = []
    for command in commands:
        if all(apart(command.q, other.q) > least for other in kept):
            kept.append(command)
    return kept


class IkVerdict(StrEnum):
    """Outcome of a goal."""

    SOLVED = "solved"
    SINGULAR = "singular"
    """Solved, but some branch is one of a continuous family, so that the list of branches is incomplete."""
    OUTSIDE_LIMITS = "outside_limits"
    """Solvable only outside the joint limits."""
    OUT_OF_REACH = "out_of_reach"
    """No joint angles solve the goal, limits or not."""


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
        """The answer with joint angles q (rad) that take the tool to a frame (4, 4)."""
        reached, angle = goal.same_kind_at(tcp), goal.angle_from(rotation_rows(tcp[:3, :3]))
        return cls(q, reached, math.dist(goal.position, reached.position), angle)


@dataclass(frozen=True, slots=True)
class NominalAnswer:
    """The answer to one goal of an arm that nothing deflects.

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
        if not self.branches:
            return _why(self.violation, self.nearest, "the nearest reachable goal")
        families = f"singular: {self.singularity}; {_counted(self.branches)}, of families"
        headline = families if self.singularity else f"solved: {_counted(self.branches)}"
        return "\n".join([headline, *map(_line, self.branches)])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reply:
    """Common part of the replies of a deployed model.

    Attributes:
        method: its name.
        left_out: effects of the model that are not compensated.
        elapsed: s.
    """

    goal: Goal
    method: str
    left_out: tuple[str, ...] = ()
    elapsed: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Solved(_Reply):
    """Commands that reach the goal, according to the model.

    Attributes:
        branches: all that were found within the limits: first the one to be commanded, its equilibrium confirmed; then
            best first: nearest to `near`, else furthest from the limits.
        tcp, rotation: predicted tool frame (m).
        predicted_error: distance from the goal's position (m).
        predicted_turn: rotation from the goal's orientation or approach (rad).
        uncertainty: of the prediction, from the parameters' covariance and the joints' repeatability; None if not
            known.
        rounded: after rounding to the servo board's counts; None without a clock. `rounded_turn`: rotation from the
            goal's orientation or approach there (rad).
        steps: of the method. `cube_error`: m, error before the final Newton's method, for the cube.
    """

    branches: tuple[Branch, ...]
    tcp: Vector3
    rotation: Rotation
    predicted_error: float
    predicted_turn: float
    uncertainty: PositionUncertainty | None
    rounded: RoundedCommand | None
    steps: int
    cube_error: float | None
    rounded_turn: float | None = None
    verdict: ClassVar[IkVerdict] = IkVerdict.SOLVED

    @property
    def q(self) -> tuple[float, ...]:
        """The commanded angles (rad): the first branch."""
        return self.branches[0].q

    @property
    def direction(self) -> tuple[int, ...]:
        """Side that each joint has to arrive from for this to hold: -1, 0 (unknown or irrelevant), +1."""
        return self.branches[0].direction

    @property
    def detours(self) -> tuple[int, ...]:
        """Joints, from 1, that would arrive from the other side if they moved straight from `near`."""
        return self.branches[0].detours

    @property
    def sd(self) -> float | None:
        """Standard deviation of the predicted position (m), three-dimensional; None if not known."""
        return None if self.uncertainty is None else self.uncertainty.sd

    def __str__(self) -> str:
        angles = " ".join(f"{math.degrees(x):.2f}" for x in self.q)
        error = f"{1e3 * self.predicted_error:.2g} mm"
        sure = "" if self.sd is None else f" ± {1e3 * self.sd:.2f} mm"
        counts = "" if self.rounded is None else f", {1e3 * self.rounded.error:.2f} mm after rounding to counts"
        words = _counted(self.branches)
        return f"solved by {self.method}: {angles} deg; predicted error {error}{sure}{counts}; {words}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Unsolved(_Reply):
    """Reason why there is no command.

    Attributes:
        nearest: the command within the limits that comes nearest, and the goal that it reaches.
        beyond: commands that would reach the goal but break limits, the least excess first.
        violation: of the first of them.
    """

    nearest: Nearest
    beyond: tuple[Branch, ...]
    violation: Violation | None

    @property
    def verdict(self) -> IkVerdict:
        """Out of reach, or outside the limits."""
        return IkVerdict.OUTSIDE_LIMITS if self.beyond else IkVerdict.OUT_OF_REACH

    def __str__(self) -> str:
        return _why(self.violation, self.nearest, "the nearest that can be commanded")


@dataclass(frozen=True, slots=True, kw_only=True)
class NotConverged(_Reply):
    """A method that ended away from the goal, though another one may reach it.

    `last`: its last command (rad), not to be sent. `errors`: m, distance from the goal after each of its steps.
    """

    last: tuple[float, ...]
    errors: tuple[float, ...]
    verdict: ClassVar[str] = "not_converged"

    def __str__(self) -> str:
        return f"{self.method} stalled {1e3 * self.errors[-1]:.2f} mm from the goal after {len(self.errors)} steps"


@dataclass(frozen=True, slots=True, kw_only=True)
class NoAllowedBranch(_Reply):
    """Commands that reach the goal within the limits, none of which the caller allows: best first."""

    branches: tuple[Branch, ...]

    def __str__(self) -> str:
        return f"{_counted(self.branches)} would take the goal, and none is allowed"


CalibratedReply: TypeAlias = Solved | Unsolved | NotConverged | NoAllowedBranch


def _counted(branches: tuple[Branch, ...]) -> str:
    return f"{len(branches)} branch{'' if len(branches) == 1 else 'es'}"


def _why(violation: Violation | None, nearest: Nearest | None, name: str) -> str:
    """Reason why there is no solution, and how far away the nearest goal is."""
    why = "out of reach" if violation is None else str(violation)
    if nearest is None:
        return why
    turn = f" and {math.degrees(nearest.angle):.2f} deg" if nearest.goal.constraints > 3 else ""
    return f"{why}; {name} is {1e3 * nearest.distance:.2f} mm{turn} away"


def _line(branch: Branch) -> str:
    angles = " ".join(f"{math.degrees(x):8.2f}" for x in branch.q)
    free = f", joint {branch.free} may turn" if branch.free is not None else ""
    return f"  {branch.label:>3} {angles} deg, {math.degrees(branch.margin):.1f} deg from the nearest limit{free}"
