"""Which of the measured poses to identify on (thesis section 6.2), and what identifying on them gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_ident.data.error_stats import ErrorFigures, figures
from lrm_ident.data.measurements import Measurements
from lrm_ident.design.detmax import STARTS, best_possible_o1, check_number, exchange, exchange_by
from lrm_ident.design.feasibility import Physical
from lrm_ident.design.fisher_information import Rows, whiten
from lrm_ident.design.observability import MM_PER_M, Index, Observability, identification_jacobian, observability
from lrm_ident.fit.levenberg_marquardt import Bounds, Fit, bounds_of, fit, no_bounds
from lrm_ident.progress import Tick, silent
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model

BLIND_DRAWS = 20


@dataclass(frozen=True, eq=False)
class Identified:
    """A fit to chosen poses, its error on all poses and on those it did not see (None if there are none).

    `broken`: parameters that came out against physics.
    """

    name: str
    fit: Fit
    on_all: ErrorFigures
    on_rest: ErrorFigures | None
    broken: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Choice:
    """Chosen rows of a data set.

    Attributes:
        value: their indices. blind: medians of as many poses drawn blindly.
        best_possible_o1: no set of so many of these poses has a larger O1.
        identified: without bounds, and with bounds in the fit.
    """

    rows: Rows
    value: Observability
    blind: Observability
    best_possible_o1: float
    identified: tuple[Identified, ...]


def choose(
    model: Model,
    data: Measurements,
    count: int,
    index: Index = "O1",
    physical: bool = False,
    seed: int = 0,
    progress: Tick = silent,
) -> Choice:
    """The poses that identify the model's free parameters best, and what identifying on them gives.

    Args:
        physical: only sets whose own unbounded identification keeps the parameters' bounds (thesis Figure 6.3).

    Raises:
        TooPoor: the data do not tell all parameters.
        LrmError: an impossible number of poses, or none of the sets found is physical.
    """
    if count < len(model.free):
        raise LrmError(f"{count} poses for {len(model.free)} parameters; choose at least {len(model.free)} (-n)")
    columns = identification_jacobian(equilibrium(model, data.poses), model.free)
    if physical:
        rows = _physical(model, data, count, seed, progress)
    else:
        rows = exchange(columns, count, index, seed=seed, progress=progress).rows
    rng = np.random.default_rng(seed)
    draws = [observability(columns[rng.choice(len(data), count, replace=False)]) for _ in range(BLIND_DRAWS)]
    blind = Observability(*np.median([list(vars(draw).values()) for draw in draws], axis=0).tolist())
    bounds = bounds_of(model, model.free)
    return Choice(
        rows,
        observability(columns[rows]),
        blind,
        best_possible_o1(columns, rows),
        tuple(
            _identify(name, model, data, rows, limits, bounds)
            for name, limits in (("no bounds", no_bounds(model.free)), ("bounds in the fit", bounds))
        ),
    )


def _physical(model: Model, data: Measurements, count: int, seed: int, progress: Tick) -> Rows:
    """The set of best O1 whose own identification is physical: linear, about the bounded fit to all poses."""
    bounds = bounds_of(model, model.free)
    near = fit(model, data, bounds)
    columns = identification_jacobian(near.rest, model.free)
    check_number(count, columns.shape)
    position = [model.position(key) for key in model.free]
    typical = np.array([model.parameters[j].typical for j in position])
    now = near.model.values[position]
    limits = (bounds.lower - now) / typical, (bounds.upper - now) / typical
    criterion = Physical(whiten(columns), near.residual * MM_PER_M, *limits)
    rows = exchange_by(criterion, count, STARTS, seed, progress).rows
    if not criterion.of(rows).feasible:
        raise LrmError(
            f"no {count} of these {len(data)} poses were found whose identification keeps the bounds of physics; "
            "ask for more poses (-n), or keep the bounds in the fit (leave --physical out)"
        )
    return rows


def _identify(name: str, model: Model, data: Measurements, rows: Rows, limits: Bounds, physics: Bounds) -> Identified:
    result = fit(model, data.take(rows), limits)
    residual = data.tcp - equilibrium(result.model, data.poses).tcp
    rest = np.setdiff1d(np.arange(len(data)), rows)
    values = [result.model.value(key) for key in model.free]
    broken = tuple(
        key
        for key, value, low, high in zip(model.free, values, physics.lower, physics.upper, strict=True)
        if not low <= value <= high
    )
    return Identified(name, result, figures(residual), figures(residual[rest]) if len(rest) else None, broken)
