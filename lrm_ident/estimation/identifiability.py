"""Identifiable parameters of a data set, and the linear combinations that the others are confounded with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.estimation.levenberg_marquardt import Bounds, Fit, bounds_of, check_enough, fit
from lrm_ident.estimation.loss import Loss
from lrm_math.arrays import Array
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import Equilibrium, equilibrium
from lrm_math.model.model import Model

ROUND_OFF = 1e-7  # a column is numerically dependent if its independent part is no more than this
MIN_T = 3.0  # typical size over standard error of a parameter worth fitting
NEGLIGIBLE = 0.05  # share of a combination that is not listed
MAX_ITERATIONS = 6
SELECTION_ORDER = (
    *("compliance.*", "offsets.*.theta_rad", "offsets.base.?_mm", "offsets.tool.?_mm"),
    *("offsets.joint*_mm", "offsets.joint*", "offsets.base.*", "offsets.tool.*", "*"),
)


@dataclass(frozen=True)
class UnidentifiableParameter:
    """A parameter held at zero because the data cannot distinguish it from others.

    Attributes:
        survival: part (0 to 1) of its Jacobian column that is linearly independent of the kept ones.
        combination: (key, amount): change of the kept parameters, in their file units, that moves the TCP as one file
            unit of this parameter does.
        standard_error: of this parameter if it were fitted too (SI); infinite if it is linearly dependent.
    """

    key: str
    survival: float
    combination: tuple[tuple[str, float], ...]
    standard_error: float


@dataclass(frozen=True)
class IdentifiableSet:
    """The parameters to fit, and those to hold at zero."""

    kept: tuple[str, ...]
    held: tuple[UnidentifiableParameter, ...]


def selection_order(model: Model, keys: Sequence[str]) -> list[str]:
    """The order of selection; of two confounded parameters the earlier one is kept.

    The most important on such an arm come first: compliances, joint zero offsets, positions of base and tool; then
    lengths and twists, each from the base outwards; then the parameters of further effects.
    """

    def rank(key: str) -> int:
        return next(i for i, pattern in enumerate(SELECTION_ORDER) if fnmatchcase(key, pattern))

    return sorted(keys, key=lambda key: (rank(key), model.position(key)))


def select_identifiable(
    rest: Equilibrium, keys: Sequence[str], noise: float, sd: Array | None = None
) -> IdentifiableSet:
    """Forward selection of parameters by Gram–Schmidt orthogonalisation of their Jacobian columns.

    A parameter is kept if the independent part of its column determines it to a third of its typical size or better at
    this noise; else the data hardly improve the prior knowledge (about zero).

    Args:
        rest: equilibrium at the poses, at the parameters to linearise about.
        keys: candidates.
        noise: expected residual of the fit, m per axis.
        sd: (N,), relative weights of the poses as in `Measurements.sd`, or None.
    """
    model = rest.model
    order = selection_order(model, keys)
    typical = np.array([model.parameters[model.position(key)].typical for key in order])
    columns = (parameter_jacobian(rest, order) * typical * _weights(sd)).reshape(-1, len(order))
    basis = np.empty((columns.shape[0], 0))
    kept: list[int] = []
    dropped: list[tuple[int, float]] = []
    for j in range(len(order)):
        whole = float(np.linalg.norm(columns[:, j]))
        left = columns[:, j] - basis @ (basis.T @ columns[:, j])
        left -= basis @ (basis.T @ left)
        independent = float(np.linalg.norm(left))
        if independent > max(MIN_T * noise, ROUND_OFF * whole):
            kept.append(j)
            basis = np.column_stack([basis, left / independent])
        else:
            dropped.append((j, independent))
    held = [
        explain_dependence(columns, typical, order, model, kept, j, independent, noise) for j, independent in dropped
    ]
    chosen = {order[j] for j in kept}
    return IdentifiableSet(tuple(key for key in model.keys if key in chosen), tuple(held))


def expected_noise(rest: Equilibrium, keys: Sequence[str], tcp: Array, sd: Array | None = None) -> float:
    """Residual standard deviation per axis (m) of a fit of `keys`, by one linear least-squares step from `rest`.

    Args:
        tcp: (N, 3), measured (m).
    """
    weights = _weights(sd)
    typical = np.array([rest.model.parameters[rest.model.position(key)].typical for key in keys])
    columns = (parameter_jacobian(rest, keys) * typical * weights).reshape(-1, len(keys))
    residual = ((tcp - rest.tcp)[:, :, None] * weights).reshape(-1)
    step, _, rank, _ = np.linalg.lstsq(columns, residual, rcond=ROUND_OFF)
    left = residual - columns @ step
    return float(np.sqrt(left @ left / max(len(left) - int(rank), 1)))


def _weights(sd: Array | None) -> Array:
    """(N, 1, 1) or (1, 1, 1), RMS of sd over sd of each pose; one where no sd is known."""
    return np.ones((1, 1, 1)) if sd is None else (np.sqrt(np.mean(sd**2)) / sd)[:, None, None]


def explain_dependence(
    columns: Array,
    typical: Array,
    order: Sequence[str],
    model: Model,
    kept: Sequence[int],
    j: int,
    independent: float,
    noise: float,
) -> UnidentifiableParameter:
    """The combination of the `kept` columns that reproduces column `j` of `columns` (3 N, P), by least squares."""
    whole = float(np.linalg.norm(columns[:, j]))
    units = np.array([model.parameters[model.position(key)].si for key in order])
    share, *_ = np.linalg.lstsq(columns[:, kept], columns[:, j], rcond=None)
    size = np.abs(share) * np.linalg.norm(columns[:, kept], axis=0)
    parts = [
        (order[k], float(amount * typical[k] / typical[j] * units[j] / units[k]))
        for k, amount, matters in sorted(zip(kept, share, size, strict=True), key=lambda part: -part[2])
        if matters > NEGLIGIBLE * whole
    ]
    survival = independent / whole if whole > 0 else 0.0
    error = noise / independent * typical[j] if survival > ROUND_OFF else np.inf
    return UnidentifiableParameter(order[j], survival, tuple(parts), float(error))


@dataclass(frozen=True, eq=False)
class IdentifiedFit:
    """A fit of the identifiable parameters, and those held at zero."""

    fit: Fit
    held: tuple[UnidentifiableParameter, ...]


def fit_identifiable(
    model: Model, data: Measurements, keys: Sequence[str], loss: Loss | None = None, signed: Bounds | None = None
) -> IdentifiedFit:
    """Fits the identifiable parameters among `keys`; the others are zero in the result.

    The selection depends on the residual noise and on the estimate, so selection and fit alternate until the selection
    repeats.

    Args:
        signed: bounds of all `keys`; None: the physical ones.

    Raises `LrmError`: fewer poses than identifiable parameters, or no convergence.
    """
    limits = signed or bounds_of(model, keys)
    by_key = {key: (low, high) for key, low, high in zip(keys, limits.lower, limits.upper, strict=True)}
    rest = equilibrium(model, data.poses)
    noise = expected_noise(rest, keys, data.tcp, data.sd)
    seen: list[tuple[str, ...]] = []
    for _ in range(MAX_ITERATIONS):
        selected = select_identifiable(rest, keys, noise, data.sd)
        check_enough(len(data), len(selected.kept))
        start = _holding(rest.model, keys, selected.kept)
        low, high = np.array([by_key[key] for key in selected.kept]).reshape(-1, 2).T
        result = fit(start, data, Bounds(low, high), loss)
        if selected.kept in seen:
            break
        seen.append(selected.kept)
        rest, noise = result.rest, result.sigma
    return IdentifiedFit(result, selected.held)


def _holding(model: Model, keys: Sequence[str], kept: Sequence[str]) -> Model:
    """The model with `kept` free and the others of `keys` at zero."""
    values = model.values.copy()
    for key in set(keys) - set(kept):
        values[model.position(key)] = 0.0
    return replace(model.with_values(values), free=tuple(kept))
