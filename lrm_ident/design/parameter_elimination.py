"""Backward elimination of parameters, one by one, by the singular values of the identification Jacobian.

As in the thesis (section 4.5), a parameter is removed while the smallest singular value lies below a threshold; the
thesis does not say which. Here, first, of all parameters in exactly dependent combinations the least important one
(`selection_order`), until none is left; then the one whose column, less what the others reproduce of it, is smallest.
The threshold is a length, mm per unit of the parameters; it grows with the root of the number of poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.observations.positions import TRACKER_SD
from lrm_ident.design.observability import (
    UNITS,
    Observability,
    Units,
    identification_jacobian,
    observability,
    singular_values,
)
from lrm_ident.fitting.dependence import ROUND_OFF, UnidentifiableParameter, explain_dependence
from lrm_ident.fitting.identifiability import selection_order
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import Equilibrium

PUBLISHED_THRESHOLD = 0.95  # Conenna 2024, section 4.5


@dataclass(frozen=True)
class RemovedParameter:
    """One parameter removed: the smallest singular value before and after, in the units of the elimination."""

    key: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class ParameterElimination:
    """The independent parameters.

    Attributes:
        keys: all parameters; kept: those that stay, in the order of the model. removals: in that order.
        held: the same parameters, and which combination of the kept ones each equals.
        all_values, kept_values: singular values by units, before and after. observability: of the kept ones, by units.
    """

    poses: int
    units: Units
    threshold: float
    keys: tuple[str, ...]
    kept: tuple[str, ...]
    removals: tuple[RemovedParameter, ...]
    held: tuple[UnidentifiableParameter, ...]
    all_values: dict[Units, Array]
    kept_values: dict[Units, Array]
    observability: dict[Units, Observability]


def eliminate(
    settled: Equilibrium,
    keys: Sequence[str],
    units: Units = "thesis",
    threshold: float = PUBLISHED_THRESHOLD,
    noise: float = TRACKER_SD,
) -> ParameterElimination:
    """Removes parameters until every singular value reaches the threshold; what went for one that went later returns.

    Args:
        settled: equilibrium at the poses, at the parameters to linearise about.
        threshold: mm per unit, see `UNITS`.
        noise: m per axis, for the standard errors of the removed parameters.

    Raises:
        LrmError: no parameter is left.
    """
    model, order = settled.model, selection_order(settled.model, keys)
    by_units = {u: identification_jacobian(settled, order, u) for u in UNITS}
    columns = by_units[units].reshape(-1, len(order))
    _, triangle = np.linalg.qr(columns)
    kept, removals = list(range(len(order))), []
    least = _smallest(triangle)
    while least < threshold:
        key = order[kept.pop(_weakest(triangle[:, kept]))]
        if not kept:
            raise LrmError(f"no parameter reaches a singular value of {threshold:g} mm; lower --threshold")
        before, least = least, _smallest(triangle[:, kept])
        removals.append(RemovedParameter(key, before, least))
    for removal in reversed(removals[:-1]):
        both = sorted([*kept, order.index(removal.key)])
        if _smallest(triangle[:, both]) >= threshold:
            kept, removals = both, [earlier for earlier in removals if earlier is not removal]
    typical = np.array([model.parameter(key).typical for key in order])
    scaled = by_units["scaled"].reshape(columns.shape) * 1e-3
    scaled[:, _zero_columns(scaled)] = 0.0
    held = [
        explain_dependence(scaled, typical, order, model, kept, j, _remainder(scaled, kept, j), noise)
        for j in (order.index(removal.key) for removal in removals)
    ]
    chosen = {order[j] for j in kept}
    return ParameterElimination(
        poses=len(settled.poses),
        units=units,
        threshold=threshold,
        keys=tuple(keys),
        kept=tuple(key for key in keys if key in chosen),
        removals=tuple(removals),
        held=tuple(held),
        all_values={u: singular_values(J) for u, J in by_units.items()},
        kept_values={u: singular_values(J[:, :, kept]) for u, J in by_units.items()},
        observability={u: observability(J[:, :, kept]) for u, J in by_units.items()},
    )


def _smallest(columns: Array) -> float:
    """Smallest singular value; 0 where there are fewer rows than columns."""
    if columns.shape[0] < columns.shape[1]:
        return 0.0
    return float(np.linalg.svd(columns, compute_uv=False)[-1])


def _weakest(columns: Array) -> int:
    """The last, hence least important, exactly dependent column; else the one with the smallest independent part."""
    zero, length = _zero_columns(columns), np.linalg.norm(columns, axis=0)
    if zero.any():
        return int(np.flatnonzero(zero)[-1])
    _, sigma, right = np.linalg.svd(columns / length)
    full = np.concatenate([sigma, np.zeros(len(right) - len(sigma))])
    dependent = np.linalg.norm(right[full < ROUND_OFF * full[0]], axis=0) > ROUND_OFF
    if dependent.any():
        return int(np.flatnonzero(dependent)[-1])
    change = length / np.linalg.norm(right / full[:, None], axis=0)
    return int(np.argmin(change))


def _zero_columns(columns: Array) -> NDArray[np.bool_]:
    """Columns that do not move the TCP at all."""
    length = np.linalg.norm(columns, axis=0)
    return np.asarray(length <= ROUND_OFF**2 * length.max())


def _remainder(columns: Array, kept: Sequence[int], j: int) -> float:
    """Norm of what no combination of the kept columns reproduces of column j (m)."""
    share, *_ = np.linalg.lstsq(columns[:, kept], columns[:, j], rcond=None)
    return float(np.linalg.norm(columns[:, j] - columns[:, kept] @ share))
