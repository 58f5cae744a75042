"""Sequential experiment design: after every batch of poses fit, diagnose, and choose the most informative next.

Chernoff 1959, Sequential Design of Experiments; batches are D-optimal for the parameters and, while effects cannot be
told apart, Ds-optimal for these (`pose_design`).
"""

from __future__ import annotations

from bisect import bisect_left
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.positions import TRACKER_SD
from lrm_ident.design.observability import identification_jacobian
from lrm_ident.design.pose_design import DesignProblem, design
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.diagnosis.screening.linearised_fit import PRIOR_SD
from lrm_ident.study.study import Study
from lrm_math.arrays import Array
from lrm_math.effects import Effect, effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model

FIRST_BATCH, BATCH = 40, 8
"""Poses: enough for a first fit of the thesis's parameters and its cross-validation; then as many at a time."""
OFFERED = 400
"""Candidates that a batch is chosen from; more are drawn at random, which hardly changes the best index."""
MOST_RIVALS = 3
SURE = 1.645
"""Standard errors of a one-sided bound that holds with 95 %."""
DRAWS = 9


@dataclass(frozen=True)
class StoppingGoal:
    """Goal at which enough is known. `error`: RMS of the held-out error (m) that must surely be reached, or None.

    `explain`: whether every missing effect must have one name.
    """

    error: float | None = None
    explain: bool = False


@dataclass(frozen=True, eq=False)
class AdaptiveFindings:
    """Knowledge from the poses so far.

    Attributes:
        model: after the last step of `auto`. named: for each effect added, its name and those it cannot be told from.
        rivals: of the first effect that has several names; `before`: the model without it.
        held_out: RMS of the held-out error (m); bound: what it is below with 95 %. noise: sd per axis of the fit (m).
    """

    model: Model
    named: tuple[tuple[str, ...], ...]
    rivals: tuple[Effect, ...]
    before: Model
    verdict: Verdict
    held_out: float
    bound: float
    noise: float

    def reached(self, goal: StoppingGoal) -> bool:
        """Whether enough is known."""
        close = goal.error is None or self.bound <= goal.error
        quiet = self.verdict.quiet
        sure = quiet and all(len(names) == 1 for names in self.named)
        return close and (sure or not goal.explain)


def assess(data: Measurements) -> AdaptiveFindings:
    """Fits the thesis's model and follows `auto`. Raises `LrmError`: too few poses, or no fit."""
    run, _ = Study.of(data).fit().auto()
    last = run.steps[-1]
    squares = (run.confirmed.held_out**2).sum(axis=1)
    error = float(squares.std(ddof=1) / np.sqrt(len(squares)))
    unsure = next((number for number, step in enumerate(run.steps) if step.evidence.equivalent), None)
    names = () if unsure is None else (run.steps[unsure].added, *run.steps[unsure].evidence.equivalent)
    return AdaptiveFindings(
        model=last.fit.model,
        named=tuple((step.added, *step.evidence.equivalent) for step in run.steps[1:]),
        rivals=tuple(effect for name in names[:MOST_RIVALS] for effect in effects_at(run.model.arm, name)),
        before=run.model if unsure is None else run.steps[max(unsure - 1, 0)].fit.model,
        verdict=run.verdict,
        held_out=float(np.sqrt(squares.mean())),
        bound=float(np.sqrt(squares.mean() + SURE * error)),
        noise=last.fit.sigma,
    )


def next_rows(
    findings: AdaptiveFindings, measured: Poses, candidates: Poses, count: int, seed: int
) -> NDArray[np.int64]:
    """Rows (count,) of the candidates to measure next; fewer if there are no more."""
    problem = DesignProblem(findings.model, None, (), count, "O1", findings.noise, measured, 0, 1, seed)
    if findings.rivals:
        with suppress(LrmError):  # where no choice of these candidates can tell them apart, the parameters are next
            return _chosen(replace(problem, model=findings.before, rivals=findings.rivals), candidates)
    return _chosen(problem, candidates)


def first_rows(model: Model, measured: Poses | None, candidates: Poses, count: int, seed: int) -> NDArray[np.int64]:
    """Rows of the candidates as long as nothing is fitted, for the parameters of the thesis. Raises `LrmError`."""
    return _chosen(DesignProblem(model, None, (), count, "O1", TRACKER_SD, measured, 0, 1, seed), candidates)


def random_poses_as_good(findings: AdaptiveFindings, measured: Poses, every: Poses, seed: int) -> int | None:
    """Number of random poses that would be expected to place the TCP as well as those measured (median draw).

    By the covariance of the fitted parameters. None: not even all of them.
    """
    settled, keys = solve_equilibrium(findings.model, every), findings.model.free
    columns = identification_jacobian(settled, keys)
    jacobian = identification_jacobian(solve_equilibrium(findings.model, measured), keys)
    wanted = _uncertainty(jacobian, columns, findings.noise)
    rng = np.random.default_rng(seed)

    def needed(order: NDArray[np.int64]) -> int:
        """Number of poses in an order that are enough, one more than all where these are not."""
        counts = range(len(every) + 1)  # the uncertainty only falls with every further pose
        enough = lambda count: _uncertainty(columns[order[:count]], columns, findings.noise) <= wanted  # noqa: E731
        return bisect_left(counts, True, lo=len(keys) // 3, key=enough)

    median = int(np.median([needed(rng.permutation(len(every))) for _ in range(DRAWS)]))
    return median if median <= len(every) else None


def _uncertainty(rows: Array, everywhere: Array, noise: float) -> float:
    """Expected RMS error of the TCP over candidates (mm), from the information of some rows."""
    stacked = rows.reshape(-1, rows.shape[2]) / (noise * 1e3)
    covariance = np.linalg.inv(stacked.T @ stacked + np.eye(rows.shape[2]) / PRIOR_SD**2)
    return float(np.sqrt(np.einsum("nci,ij,ncj->n", everywhere, covariance, everywhere, optimize=True).mean()))


def _chosen(problem: DesignProblem, candidates: Poses) -> NDArray[np.int64]:
    if len(candidates) <= problem.count:
        return np.arange(len(candidates))
    already = 0 if problem.measured is None else len(problem.measured)
    rng = np.random.default_rng([problem.seed, already])
    offered = rng.choice(len(candidates), min(OFFERED, len(candidates)), replace=False)
    few = replace(candidates.take(offered), direction=None, number=None)
    designed = design(problem, few)
    row_of = {(q.tobytes(), load): row for row, q, load in zip(offered, few.q, few.payload.tolist(), strict=True)}
    keys = zip(designed.poses.q, designed.poses.payload.tolist(), strict=True)
    return np.array(sorted({int(row_of[q.tobytes(), load]) for q, load in keys}))
