"""Collinearity: parameters that the data cannot tell from others, and the combination of those that each equals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.model.model import Model

ROUND_OFF = 1e-7  # relative size of a numerically dependent column's independent part
NOT_LISTED = 0.05  # share of a combination


@dataclass(frozen=True)
class UnidentifiableParameter:
    """A parameter held at zero because the data cannot distinguish it from others.

    Attributes:
        survival: part (0 to 1) of its Jacobian column that is linearly independent of the kept ones, √(1 − R²).
        combination: (key, amount): change of the kept parameters, in their file units, that moves the TCP as one file
            unit of this parameter does.
        standard_error: of this parameter if it were fitted too (SI); infinite if it is linearly dependent.
    """

    key: str
    survival: float
    combination: tuple[tuple[str, float], ...]
    standard_error: float


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
    """Combination of the `kept` columns that reproduces column `j` of `columns` (M, P), by least squares.

    Args:
        typical: (P,), typical sizes of the parameters `order` (SI). independent: norm of the column's independent part.
        noise: in the unit of the columns, for the standard error.
    """
    whole = float(np.linalg.norm(columns[:, j]))
    units = np.array([model.parameter(key).si for key in order])
    share, *_ = np.linalg.lstsq(columns[:, kept], columns[:, j], rcond=None)
    size = np.abs(share) * np.linalg.norm(columns[:, kept], axis=0)
    parts = [
        (order[k], float(amount * typical[k] / typical[j] * units[j] / units[k]))
        for k, amount, matters in sorted(zip(kept, share, size, strict=True), key=lambda part: -part[2])
        if matters > NOT_LISTED * whole
    ]
    survival = independent / whole if whole > 0 else 0.0
    error = noise / independent * typical[j] if survival > ROUND_OFF else np.inf
    return UnidentifiableParameter(order[j], survival, tuple(parts), float(error))
