"""What a residual field must not do: appear where nothing is left, mislead beyond its data, slow down the inverse."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.field.fit import fit_with_field
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.study.field_step import NoBetterPrediction
from lrm_ident.study.study import Study
from lrm_math.ik.answer import Solved
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.calibrated_arm import Method
from lrm_math.ik.cube import Cube
from lrm_math.ik.direct import Direct
from lrm_math.ik.goal import Goal
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import named_part
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model
from validation.residual_field.nameless_arm import measured

METHODS: tuple[Method, Method] = (Direct(), Cube())


def refused_on_null_data(seeds: int) -> int:
    """How many arms without anything left get no field."""
    refused = 0
    for seed in range(100, 100 + seeds):
        try:
            Study.of(measured(seed, 0.0)).fit("option1").add_field()
        except NoBetterPrediction:
            refused += 1
    return refused


def worst_on_other_half(data: Measurements, parameters: str = "option1") -> tuple[float, str]:
    """Largest error (RMS) with a field over that without, where one joint stands on the other side of its median from
    all poses that both were fitted on; and which joint and side. The field is added whether it helps or not."""
    start, worst, which = Study.of(data).fit(parameters).model, 0.0, ""
    for joint, column in enumerate(data.poses.q.T):
        for name, side in (("below", column < np.median(column)), ("above", column > np.median(column))):
            known, other = data.take(side), data.take(~side)
            if len(known) < 2 * len(start.free) or not len(other):
                continue
            plain = fit(start, known)
            errors = [
                error_stats(other.position_error(equilibrium(model, other.poses))).rms
                for model in (plain.model, fit_with_field(plain, known).model)
            ]
            if errors[1] / errors[0] > worst:
                worst, which = errors[1] / errors[0], f"joint {joint + 1}, learned {name} its median"
    return worst, which


@dataclass(frozen=True)
class InverseOutcome:
    """Goals that are solved, largest error of a branch (m), branches per goal, and median processor time (s)."""

    method: str
    solved: int
    worst: float
    branches: float
    median: float


def inverse(model: Model, goals: int) -> list[tuple[InverseOutcome, InverseOutcome]]:
    """Outcomes without the model's field and with it, for each method, of random reachable goals."""
    lower, upper = (np.array([getattr(joint, end) for joint in model.arm.joints]) for end in ("lower", "upper"))
    commands = np.random.default_rng(0).uniform(lower, upper, (goals, len(lower)))
    solvers = [CalibratedSolver.of(one) for one in (named_part(model), model)]
    for solver in solvers:
        solver.warm_up()
    return [(_solved(solvers[0], commands, method), _solved(solvers[1], commands, method)) for method in METHODS]


def _solved(solver: CalibratedSolver, commands: np.ndarray, method: Method) -> InverseOutcome:
    solved, branches, worst, times = 0, 0, 0.0, []
    for q in commands.tolist():
        there = solver.forward(q)
        begun = time.process_time()
        reply = solver.solve(Goal(there.tcp, there.rotation), method=method)
        times.append(time.process_time() - begun)
        if isinstance(reply, Solved):
            rest = equilibrium(solver.arm.model, poses_of([branch.q for branch in reply.branches]), tolerance=1e-12)
            solved, branches = solved + 1, branches + len(reply.branches)
            worst = max(worst, float(np.linalg.norm(rest.tcp - there.tcp, axis=1).max()))
    return InverseOutcome(method.name, solved, worst, branches / max(solved, 1), float(np.median(times)))
