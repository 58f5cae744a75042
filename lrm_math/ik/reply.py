"""Answers of calibrated inverse kinematics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

from lrm_math.arm.joint_limits import Violation
from lrm_math.arm.pulse_rounding import RoundedCommand
from lrm_math.arrays import Vector3
from lrm_math.ik.answer import Branch, IkVerdict, Nearest
from lrm_math.ik.goal import Goal, Rotation
from lrm_math.model.uncertainty import PositionUncertainty


@dataclass(frozen=True, slots=True)
class Solved:
    """Commands that reach the goal, according to the model.

    Attributes:
        q: the commanded angles (rad): the first branch.
        branches: all that were found within the limits, best first: nearest to `near`, else furthest from the limits.
        tcp, rotation: predicted tool frame (m).
        predicted_error: distance from the goal's position (m).
        predicted_turn: rotation from the goal's orientation or approach (rad).
        uncertainty: of the prediction, from the parameters' covariance and the joints' repeatability; None if not
            known.
        direction: side that each joint has to arrive from for this to hold: -1, 0 (unknown or irrelevant), +1.
        detours: joints, from 1, that would arrive from the other side if they moved straight from `near`.
        rounded: after rounding to the servo board's counts; None without a clock.
        steps: of the method. `cube_error`: m, error before the final Newton's method, for the cube.
        left_out: effects of the model that are not compensated.
        elapsed: s.
    """

    goal: Goal
    q: tuple[float, ...]
    branches: tuple[Branch, ...]
    tcp: Vector3
    rotation: Rotation
    predicted_error: float
    predicted_turn: float
    uncertainty: PositionUncertainty | None
    direction: tuple[int, ...]
    detours: tuple[int, ...]
    rounded: RoundedCommand | None
    method: str
    steps: int
    cube_error: float | None
    left_out: tuple[str, ...]
    elapsed: float

    @property
    def verdict(self) -> IkVerdict:
        """Solved."""
        return IkVerdict.SOLVED

    @property
    def sd(self) -> float | None:
        """Standard deviation of the predicted position (m), three-dimensional; None if not known."""
        return None if self.uncertainty is None else self.uncertainty.sd

    def __str__(self) -> str:
        angles = " ".join(f"{math.degrees(x):.2f}" for x in self.q)
        error = f"{1e3 * self.predicted_error:.2g} mm"
        sure = "" if self.sd is None else f" ± {1e3 * self.sd:.2f} mm"
        counts = "" if self.rounded is None else f", {1e3 * self.rounded.error:.2f} mm after rounding to counts"
        return (
            f"solved by {self.method}: {angles} deg; predicted error {error}{sure}{counts}; "
            f"{len(self.branches)} branch{'' if len(self.branches) == 1 else 'es'}"
        )


@dataclass(frozen=True, slots=True)
class Unsolved:
    """Why there is no command.

    Attributes:
        verdict: out_of_reach or outside_limits.
        nearest: the command within the limits that comes nearest, and the goal that it reaches.
        beyond: commands that would reach the goal but break limits, the least excess first.
        violation: of the first of them.
    """

    goal: Goal
    verdict: IkVerdict
    nearest: Nearest
    beyond: tuple[Branch, ...]
    violation: Violation | None
    method: str
    left_out: tuple[str, ...]
    elapsed: float

    def __str__(self) -> str:
        why = "out of reach" if self.violation is None else str(self.violation)
        turn = f" and {math.degrees(self.nearest.angle):.2f} deg" if self.nearest.angle else ""
        return f"{why}; the nearest that can be commanded is {1e3 * self.nearest.distance:.2f} mm{turn} away"


@dataclass(frozen=True, slots=True)
class NotConverged:
    """A method that ended away from the goal, though another one may reach it.

    `last`: its last command (rad), not to be sent. `errors`: m, distance from the goal after each of its steps.
    """

    goal: Goal
    last: tuple[float, ...]
    errors: tuple[float, ...]
    method: str
    left_out: tuple[str, ...]
    elapsed: float

    @property
    def verdict(self) -> str:
        """Of the method, not of the goal."""
        return "not_converged"

    def __str__(self) -> str:
        return f"{self.method} stalled {1e3 * self.errors[-1]:.2f} mm from the goal after {len(self.errors)} steps"


@dataclass(frozen=True, slots=True)
class NoAllowedBranch:
    """Commands that reach the goal within the limits, none of which the caller allows: best first."""

    goal: Goal
    branches: tuple[Branch, ...]
    method: str
    left_out: tuple[str, ...]
    elapsed: float

    def __str__(self) -> str:
        count = len(self.branches)
        return f"{count} branch{'' if count == 1 else 'es'} would take the goal, and none is allowed"


CalibratedReply: TypeAlias = Solved | Unsolved | NotConverged | NoAllowedBranch
