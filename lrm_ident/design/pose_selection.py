"""Pose selection among measured poses (thesis section 6.2), and the identification on the selected ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.design.detmax import STARTS, check_count, exchange, maximise_criterion, o1_upper_bound
from lrm_ident.design.fisher_information import Rows, whiten
from lrm_ident.design.observability import MM_PER_M, Index, Observability, identification_jacobian, observability
from lrm_ident.design.optimality import FeasibleCriterion
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.parameter_sets import Bounds, bounds_of, no_bounds
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model

RANDOM_DRAWS = 20


@dataclass(frozen=True, eq=False)
class SubsetFit:
    """A fit to selected poses, its error on all and on the rest (None if none), parameters out of physical bounds."""

    name: str
    fit: Fit
    error_all: ErrorStats
    error_rest: ErrorStats | None
    violated_bounds: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PoseSelection:
    """Selected rows of a data set, their indices, the medians for as many random poses, and the bound of O1 for sets of
    this size; `fits` to the selected poses, without bounds and with bounds.
    """

    rows: Rows
    observability: Observability
    random_baseline: Observability
    o1_upper_bound: float
    fits: tuple[SubsetFit, ...]


def select_poses(
    model: Model,
    data: Measurements,
    count: int,
    index: Index = "O1",
    physical: bool = False,
    seed: int = 0,
    progress: OnProgress = silent,
) -> PoseSelection:
    """The poses that maximise an index of the model's free parameters, weighed as in the fit; and the fits to them.

    Args:
        physical: only sets whose own unbounded identification keeps the parameters' bounds (thesis Figure 6.3).

    Raises:
        RankDeficient: the data do not determine all parameters.
        LrmError: an impossible number of poses, or none of the sets found is feasible.
    """
    if count < len(model.free):
        raise LrmError(f"{count} poses for {len(model.free)} parameters; choose at least {len(model.free)} (-n)")
    columns = identification_jacobian(solve_equilibrium(model, data.poses), model.free, whitening=data.whitening)
    if physical:
        rows = _select_feasible(model, data, count, seed, progress)
    else:
        rows = exchange(columns, count, index, seed=seed, progress=progress).rows
    rng = np.random.default_rng(seed)
    draws = [rng.choice(len(data), count, replace=False) for _ in range(RANDOM_DRAWS)]
    bounds = bounds_of(model, model.free)
    limits = {"no bounds": no_bounds(model.free), "bounds in the fit": bounds}
    return PoseSelection(
        rows,
        observability(columns[rows]),
        Observability.median(columns, draws),
        o1_upper_bound(columns, rows),
        tuple(_fit_subset(name, model, data, rows, limit, bounds) for name, limit in limits.items()),
    )


def _select_feasible(model: Model, data: Measurements, count: int, seed: int, progress: OnProgress) -> Rows:
    """The set of best O1 whose own identification, linear about the bounded fit to all poses, keeps the bounds."""
    bounds = bounds_of(model, model.free)
    fitted = fit(model, data, bounds)
    columns = identification_jacobian(fitted.equilibrium, model.free, whitening=data.whitening)
    check_count(count, len(columns), columns.shape[2], rows=columns.shape[1])
    position = [model.position(key) for key in model.free]
    typical = np.array([model.parameters[j].typical for j in position])
    values = fitted.model.values[position]
    limits = (bounds.lower - values) / typical, (bounds.upper - values) / typical
    residual = data.whitening.unit * data.whitening(data.residual(fitted.equilibrium)) * MM_PER_M
    criterion = FeasibleCriterion(whiten(columns), residual, *limits)
    rows = maximise_criterion(criterion, count, STARTS, seed, progress).rows
    if not criterion.evaluate(rows).feasible:
        raise LrmError(
            f"no {count} of these {len(data)} poses were found whose identification keeps the bounds of physics; "
            "ask for more poses (-n), or keep the bounds in the fit (leave --physical out)"
        )
    return rows


def _fit_subset(name: str, model: Model, data: Measurements, rows: Rows, limits: Bounds, physics: Bounds) -> SubsetFit:
    result = fit(model, data.take(rows), limits)
    residual = data.position_error(solve_equilibrium(result.model, data.poses))
    rest = np.setdiff1d(np.arange(len(data)), rows)
    values = [result.model.value(key) for key in model.free]
    violated = tuple(
        key
        for key, value, low, high in zip(model.free, values, physics.lower, physics.upper, strict=True)
        if not low <= value <= high
    )
    return SubsetFit(name, result, error_stats(residual), error_stats(residual[rest]) if len(rest) else None, violated)
