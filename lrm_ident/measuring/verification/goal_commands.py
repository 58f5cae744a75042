"""Commands for goals of the tip: whoever gives them, and the inverse kinematics of a model file."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_digest import WHAT_COUNTS, arm_sha256
from lrm_math.effects import compensable
from lrm_math.errors import FileError, LrmError
from lrm_math.ik.answer import Solved
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import Goal
from lrm_math.model.model import model_of
from lrm_math.model.model_file import FIT_AGAIN, ModelFile, load_covariance, load_model
from lrm_math.toml_file import read_toml

NOMINAL = "nominal"


@dataclass(frozen=True)
class GoalCommand:
    """A command (n,), rad, in whole counts. `rounding`: error that the model predicts from rounding to them (m).

    `sd`: standard deviation of a new measurement about the model's prediction (m), None without a covariance: of the
    prediction itself, and what the model left at the poses of its fit (Draper & Smith 1998, section 1.4).
    """

    q: tuple[float, ...]
    rounding: float
    sd: float | None


class GoalSolver(Protocol):
    """Inverse kinematics with a model of that name and SHA-256 (empty: the nominal arm)."""

    @property
    def model(self) -> str: ...
    @property
    def model_sha256(self) -> str: ...

    def solve(self, goal: Goal, near: Sequence[float], payload: float) -> GoalCommand | str:
        """The command for a goal, from commanded angles (n,), rad, with a payload (kg), or why not."""


@dataclass(frozen=True, eq=False)
class ModelSolver:
    """See `GoalSolver`: with a model of its own. `rounded`: the nearest angles that the servos take.

    `residual`: RMS error that the model left at the poses of its fit (m).
    """

    solver: CalibratedSolver
    rounded: Callable[[Sequence[float]], tuple[float, ...]]
    model: str = NOMINAL
    model_sha256: str = ""
    residual: float = 0.0

    @classmethod
    def of(cls, path: Path | None, arm: Arm, rounded: Callable[[Sequence[float]], tuple[float, ...]]) -> ModelSolver:
        """The solver of a model file, or of the arm as drawn. Raises `FileError`: another arm's, or none."""
        if path is None:
            return cls(CalibratedSolver.of(model_of(arm, ())), rounded)
        model = load_model(path)
        if model.arm.name != arm.name:
            raise FileError(path, "arm", f"a model of {model.arm.name}", f"the arm is {arm.name}; give --arm")
        if arm_sha256(model.arm) != arm_sha256(arm):
            raise FileError(path, "arm", f"a model of another {arm.name}: {WHAT_COUNTS} differ", FIT_AGAIN)
        left_out = sorted({effect.id for effect in model.effects if not compensable(effect)})
        solver = CalibratedSolver.of(model, left_out=left_out, covariance=load_covariance(path))
        residual = read_toml(path, ModelFile).residual
        return cls(solver, rounded, str(path), hashlib.sha256(path.read_bytes()).hexdigest(), residual)

    def solve(self, goal: Goal, near: Sequence[float], payload: float) -> GoalCommand | str:
        """See `GoalSolver`."""
        try:
            reply = self.solver.solve(goal, payload, near)
            if not isinstance(reply, Solved):
                return str(reply)
            q = self.rounded(reply.q)
            rounding = math.dist(self.solver.forward(q, payload, near).tcp, reply.tcp)
        except LrmError as error:
            return str(error)
        return GoalCommand(q, rounding, of_a_measurement(reply.sd, self.residual))


def of_a_measurement(sd: float | None, residual: float) -> float | None:
    """Standard deviation (m) of a measurement about a prediction: of this, and what the model left."""
    return None if sd is None else math.hypot(sd, residual)
