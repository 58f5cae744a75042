"""From all parameters to an independent set, one by one, by the singular values of the identification Jacobian.

The thesis's way (section 4.5): as long as the smallest singular value lies below a threshold, a parameter goes; which
one, it leaves open. Here, first, whatever others reproduce exactly: of all parameters in such combinations the least
important one goes (`preference`), until none is left. Then the one whose own motion, less what the others can
reproduce of it, is smallest. The threshold is a length, mm per unit of the parameters; it grows with the root of the
number of poses, and means something only together with the units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.design.observability import (
    UNITS,
    Observability,
    Units,
    identification_jacobian,
    observability,
    singular_values,
)
from lrm_ident.fit.identifiability import ROUND_OFF, Unidentifiable, describe, preference
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model

PUBLISHED_THRESHOLD = 0.95  # Conenna 2024, section 4.5


@dataclass(frozen=True)
class Removal:
    """One parameter taken out: the smallest singular value before and after, in the units of the elimination."""

    key: str
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Elimination:
    """The independent parameters.

    Attributes:
        keys: all parameters; kept: those that stay, in the order of the model.
        removals: in the order in which they went. held: the same parameters, and what of the kept ones each amounts to.
        all_values, kept_values: singular values by units, before and after. observability: of the kept ones, by units.
    """

    poses: int
    units: Units
    threshold: float
    keys: tuple[str, ...]
    kept: tuple[str, ...]
    removals: tuple[Removal, ...]
    held: tuple[Unidentifiable, ...]
    all_values: dict[Units, Array]
    kept_values: dict[Units, Array]
    observability: dict[Units, Observability]


def fittable(model: Model) -> tuple[str, ...]:
    """All parameters but shapes."""
    return tuple(key for key, p in zip(model.keys, model.parameters, strict=True) if p.fixed is None)


def eliminate(
    rest: Equilibrium,
    keys: Sequence[str],
    units: Units = "thesis",
    threshold: float = PUBLISHED_THRESHOLD,
    noise: float = 3e-4,
) -> Elimination:
    """Takes parameters out until every singular value reaches the threshold.

    Args:
        rest: equilibrium at the poses, at the parameters to linearise about.
        threshold: mm per unit, see `UNITS`.
        noise: m per axis, for the standard errors of the parameters taken out.

    Raises:
        LrmError: no parameter is left.
    """
    order = preference(rest.model, keys)
    by_units = {u: identification_jacobian(rest, order, u) for u in UNITS}
    columns = by_units[units].reshape(-1, len(order))
    _, triangle = np.linalg.qr(columns)
    kept, removals = list(range(len(order))), []
    least = _least(triangle)
    while least < threshold:
        out = _weakest(triangle[:, kept])
        key = order[kept.pop(out)]
        if not kept:
            raise LrmError(f"no parameter reaches a singular value of {threshold:g} mm; lower --threshold")
        before, least = least, _least(triangle[:, kept])
        removals.append(Removal(key, before, least))
    typical = np.array([rest.model.parameters[rest.model.position(key)].typical for key in order])
    scaled = by_units["scaled"].reshape(columns.shape) * 1e-3
    scaled[:, _nothing(scaled)] = 0.0
    held = [
        describe(scaled, typical, order, rest.model, kept, j, _left(scaled, kept, j), noise)
        for j in (order.index(removal.key) for removal in removals)
    ]
    chosen = {order[j] for j in kept}
    return Elimination(
        poses=len(rest.poses),
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


def _least(columns: Array) -> float:
    """Smallest singular value; 0 where there are fewer rows than columns."""
    if columns.shape[0] < columns.shape[1]:
        return 0.0
    return float(np.linalg.svd(columns, compute_uv=False)[-1])


def _weakest(columns: Array) -> int:
    """The last, hence least important, column that others reproduce exactly; else the one with least of its own."""
    nothing, length = _nothing(columns), np.linalg.norm(columns, axis=0)
    if nothing.any():
        return int(np.flatnonzero(nothing)[-1])
    _, sigma, right = np.linalg.svd(columns / length)
    full = np.concatenate([sigma, np.zeros(len(right) - len(sigma))])
    dependent = np.linalg.norm(right[full < ROUND_OFF * full[0]], axis=0) > ROUND_OFF
    if dependent.any():
        return int(np.flatnonzero(dependent)[-1])
    own = length / np.linalg.norm(right / full[:, None], axis=0)
    return int(np.argmin(own))


def _nothing(columns: Array) -> NDArray[np.bool_]:
    """Columns that do not move the TCP at all."""
    length = np.linalg.norm(columns, axis=0)
    return np.asarray(length <= ROUND_OFF**2 * length.max())


def _left(columns: Array, kept: Sequence[int], j: int) -> float:
    """What of column j (m) no combination of the kept ones reproduces."""
    share, *_ = np.linalg.lstsq(columns[:, kept], columns[:, j], rcond=None)
    return float(np.linalg.norm(columns[:, j] - columns[:, kept] @ share))
