"""Goals of the tip through the calibrated inverse kinematics, and where the tip lands: what a deployment is worth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lrm_ident.campaign.plan import PlannedPose
from lrm_ident.campaign.rover_arm import RoverArm
from lrm_ident.campaign.run import Clock, Rhythm, Unreachable, rest_at
from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.tracker.dwell import RestMean
from lrm_ident.tracker.frames import TargetNumbers, Tracker
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import model_of
from lrmd.client import GoalEntry, IkAnswer, IkRequest

DEADLINE_MS = 10_000.0
HIGHEST_SHARE = 0.8
"""Of a joint's range: goals at the edge of the reach are reached by some models and not by others."""


@dataclass(frozen=True)
class Landing:
    """Where the tip landed that was sent to a goal, m.

    `goal`, `tip`: (3,). `rounding`: error that the model predicts from rounding to counts. `sd`: standard deviation of
    the model's prediction, None without a covariance. `spread`: of the rest's mean, per axis.
    """

    number: int
    goal: tuple[float, ...]
    tip: tuple[float, ...]
    rounding: float
    sd: float | None
    spread: float

    @property
    def error(self) -> float:
        """Distance of the tip from the goal."""
        return float(np.linalg.norm(np.subtract(self.tip, self.goal)))


@dataclass(frozen=True)
class Verification:
    """Landings with the model of that SHA-256 (empty: the nominal arm), and goals not reached, with the reason."""

    model: str
    model_sha256: str
    landings: tuple[Landing, ...]
    failed: dict[int, str]

    @property
    def error(self) -> ErrorStats:
        """Distances of the tip from the goals. Raises `LrmError` if no goal was reached."""
        if not self.landings:
            raise LrmError(f"no goal was reached; {next(iter(self.failed.values()), 'there was none')}")
        return error_stats(np.array([np.subtract(one.tip, one.goal) for one in self.landings]))

    @property
    def predicted(self) -> float | None:
        """RMS of the error that the model itself expects: rounding and its own uncertainty; None without covariance."""
        known = [(one.rounding, one.sd) for one in self.landings if one.sd is not None]
        return float(np.sqrt(np.mean(np.square(known).sum(axis=1)))) if known else None

    @property
    def rounding(self) -> float:
        """RMS of the predicted error of rounding to counts."""
        return float(np.sqrt(np.mean([one.rounding**2 for one in self.landings])))


@dataclass(frozen=True)
class GoalRun:
    """What goals are tried with."""

    arm: RoverArm
    tracker: Tracker
    numbers: TargetNumbers
    clock: Clock
    rhythm: Rhythm
    payload: float

    def visit(self, goals: Sequence[Sequence[float]], on_landing: Callable[[int, str], object]) -> Verification:
        """Sends the tip to every goal (m), and measures where it lands."""
        landings, failed = [], {}
        model = self.arm.rover.info()
        for number, goal in enumerate(goals, start=1):
            found = self._land(number, goal)
            if isinstance(found, Landing):
                landings.append(found)
                on_landing(number, f"{found.error * 1e3:.2f} mm off")
            else:
                failed[number] = found
                on_landing(number, found)
        return Verification(model.model or "nominal", model.model_sha256, tuple(landings), failed)

    def _land(self, number: int, goal: Sequence[float]) -> Landing | str:
        answer = self._solve(goal)
        if answer.rounded_q_rad is None:
            return f"{answer.verdict}: {answer.text}"
        pose = PlannedPose(number, tuple(answer.rounded_q_rad), self.payload, 0, number)
        why = ""
        for _ in range(self.rhythm.attempts):
            try:
                self.arm.go(pose)
            except Unreachable as error:
                return str(error)
            rest = rest_at(self.tracker, self.numbers, self.clock, self.rhythm, self.clock.now())
            if isinstance(rest, RestMean):
                spread = rest.sd / rest.frames**0.5
                rounding = answer.rounded_error_m or 0.0
                return Landing(number, tuple(goal), tuple(rest.tip.tolist()), rounding, answer.sd_m, spread)
            why = rest.why
        return why

    def _solve(self, goal: Sequence[float]) -> IkAnswer:
        here = self.arm.rover.commanded_q()
        entry = GoalEntry(position_m=list(goal))
        request = IkRequest(
            goals=[entry],
            near_rad=here,
            payload_kg=self.payload,
            round="best",
            method="direct",
            deadline_ms=DEADLINE_MS,
        )
        return self.arm.rover.ik(request).answers[0]


def draw_goals(arm: Arm, count: int, seed: int, allowed: Callable[[Array], Array]) -> Array:
    """(count, 3), tips (m) of the nominal arm at random angles in the middle of the range, the same for every model.

    `allowed`: which of angles (N, n) are free of collisions, (N,).
    """
    rng = np.random.default_rng([seed, 2])
    low, high = HIGHEST_SHARE * np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    found = np.empty((0, 3))
    for _ in range(100):
        q = rng.uniform(low, high, size=(4 * count, arm.dof))
        free = q[allowed(q)]
        if len(free):
            found = np.concatenate([found, equilibrium(model_of(arm, ()), poses_of(free)).tcp])
        if len(found) >= count:
            return found[:count]
    raise LrmError(f"{arm.name}: hardly any pose keeps clear of everything")
