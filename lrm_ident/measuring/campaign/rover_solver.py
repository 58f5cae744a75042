"""Commands for goals of the tip from a daemon's inverse kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lrm_ident.measuring.verification.goal_commands import NOMINAL, GoalCommand
from lrmd.client import GoalEntry, IkRequest, Rover

DEADLINE_MS = 10_000.0


@dataclass(frozen=True)
class DaemonSolver:
    """See `GoalSolver`: with the model that a daemon uses."""

    rover: Rover
    model: str
    model_sha256: str

    @classmethod
    def of(cls, rover: Rover) -> DaemonSolver:
        """The solver of a daemon."""
        info = rover.info()
        return cls(rover, info.model or NOMINAL, info.model_sha256)

    def solve(self, goal: Sequence[float], near: Sequence[float], payload: float) -> GoalCommand | str:
        """See `GoalSolver`."""
        request = IkRequest(
            goals=[GoalEntry(position_m=list(goal))],
            near_rad=list(near),
            payload_kg=payload,
            round="best",
            method="direct",
            deadline_ms=DEADLINE_MS,
        )
        answer = self.rover.ik(request).answers[0]
        if answer.rounded_q_rad is None:
            return f"{answer.verdict}: {answer.text}"
        return GoalCommand(tuple(answer.rounded_q_rad), answer.rounded_error_m or 0.0, answer.sd_m)
