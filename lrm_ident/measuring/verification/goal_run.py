"""Goals of the tip through the inverse kinematics of a model, and where the tip lands: what the model is worth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.rigid_motion import rotation_vectors
from lrm_ident.data.wording import in_mm
from lrm_ident.measuring.campaign.plan import PlannedPose, lightest
from lrm_ident.measuring.campaign.run import CampaignArm, Clock, PoseTiming, Unreachable, rest_at
from lrm_ident.measuring.tracker.dwell import RestMean, UnstableDwell
from lrm_ident.measuring.tracker.frames import TargetNumbers, Tracker
from lrm_ident.measuring.verification.goal_commands import GoalSolver
from lrm_ident.measuring.verification.goals import PlacedGoal
from lrm_math.arm.arm import Arm
from lrm_math.errors import LrmError


@dataclass(frozen=True)
class AttainedPosition:
    """Position that the tip attained where it was sent to a goal, m (ISO 9283: attained and command position).

    `place`: what is there, in words, or empty. `goal`, `tip`: (3,). `rounding`: error that the model predicts from
    rounding to counts. `sd`: standard deviation of a measurement about the prediction, None without a covariance.
    `spread`: of the rest's mean, per axis. `turn`: angle between the tool and the orientation of the goal (rad); None
    where the goal has none, or the tracker did not see the tool's.
    """

    number: int
    place: str
    goal: tuple[float, ...]
    tip: tuple[float, ...]
    rounding: float
    sd: float | None
    spread: float
    turn: float | None = None

    @property
    def error(self) -> float:
        """Distance of the tip from the goal."""
        return float(np.linalg.norm(np.subtract(self.tip, self.goal)))


@dataclass(frozen=True)
class Verification:
    """Positions attained with the model of that SHA-256 (empty: the nominal arm); goals not reached, and why."""

    model: str
    model_sha256: str
    attained: tuple[AttainedPosition, ...]
    failed: dict[int, str]

    @property
    def error(self) -> ErrorStats:
        """Distances of the tip from the goals. Raises `LrmError` if no goal was reached."""
        if not self.attained:
            raise LrmError(f"no goal was reached; {next(iter(self.failed.values()), 'there was none')}")
        return error_stats(np.array([np.subtract(goal.tip, goal.goal) for goal in self.attained]))

    @property
    def predicted(self) -> float | None:
        """RMS of the error that is expected: rounding, and `sd`; None without a covariance."""
        stated = [(goal.rounding, goal.sd) for goal in self.attained if goal.sd is not None]
        return float(np.sqrt(np.mean(np.square(stated).sum(axis=1)))) if stated else None

    @property
    def turn(self) -> float | None:
        """RMS of the angles between the tool and the goals' orientations (rad); None where none is known."""
        turns = [goal.turn for goal in self.attained if goal.turn is not None]
        return float(np.sqrt(np.mean(np.square(turns)))) if turns else None

    def at(self, place: str) -> Verification:
        """The positions attained at one place."""
        return replace(self, attained=tuple(goal for goal in self.attained if goal.place == place), failed={})

    @property
    def places(self) -> tuple[str, ...]:
        """The places that goals were at, each once."""
        return tuple(dict.fromkeys(goal.place for goal in self.attained))

    @property
    def rounding(self) -> float:
        """RMS of the predicted error of rounding to counts."""
        return float(np.sqrt(np.mean([goal.rounding**2 for goal in self.attained])))


@dataclass(frozen=True)
class GoalRun:
    """Parts that goals are tried with. `nominal`: the arm as drawn, for the pose to cool at."""

    arm: CampaignArm
    solver: GoalSolver
    nominal: Arm
    tracker: Tracker
    numbers: TargetNumbers
    clock: Clock
    timing: PoseTiming
    payload: float

    def visit(self, goals: Sequence[PlacedGoal], on_attained: Callable[[int, str], object]) -> Verification:
        """Sends the tip to every goal, and measures where it lands. A servo that is too warm cools first."""
        attained, failed = [], {}
        reached = [self._here()]
        for number, goal in enumerate(goals, start=1):
            if why := self.arm.too_warm():
                on_attained(number, f"{why}: cooling")
                self.arm.cool(lightest(reached, self.nominal))
            outcome = self._land(number, goal)
            reached.append(self._here())
            if isinstance(outcome, AttainedPosition):
                attained.append(outcome)
                on_attained(number, f"{in_mm(outcome.error)} mm off")
            else:
                failed[number] = outcome
                on_attained(number, outcome)
        return Verification(self.solver.model, self.solver.model_sha256, tuple(attained), failed)

    def _here(self) -> PlannedPose:
        return PlannedPose(0, self.arm.commanded(), self.payload, (), 0)

    def _land(self, number: int, goal: PlacedGoal) -> AttainedPosition | str:
        command = self.solver.solve(goal.goal, self.arm.commanded(), self.payload)
        if isinstance(command, str):
            return command
        pose = PlannedPose(number, command.q, self.payload, (), number)
        why = ""
        for _ in range(self.timing.attempts):
            try:
                self.arm.go(pose)
            except Unreachable as error:
                return str(error)
            rest = rest_at(self.tracker, self.numbers, self.clock, self.timing, self.clock.now())
            why = self.arm.disturbed() or (rest.why if isinstance(rest, UnstableDwell) else "")
            if isinstance(rest, RestMean) and not why:
                spread = rest.sd / rest.frames**0.5
                tip = tuple(rest.tip.tolist())
                figures = (command.rounding, command.sd, spread, angle_between(goal, rest))
                return AttainedPosition(number, goal.place, goal.position, tip, *figures)
        return why


def angle_between(goal: PlacedGoal, rest: RestMean) -> float | None:
    """Angle (rad) between the tool at rest and the orientation of its goal."""
    if goal.rotation is None or rest.rotation is None:
        return None
    return float(np.linalg.norm(rotation_vectors((np.array(goal.rotation).T @ rest.rotation)[None])))
