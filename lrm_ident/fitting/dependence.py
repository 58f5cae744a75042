"""Parameters that the data cannot distinguish from others, and the combination of the others that each looks like."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.model.model import Model

ROUND_OFF = 1e-7  # a column is numerically dependent if its independent part is no more than this
NEGLIGIBLE = 0.05  # share of a combination that is not listed


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
    """The combination of the `kept` columns that reproduces column `j` of `columns` (M, P), by least squares."""
    whole = float(np.linalg.norm(columns[:, j]))
    units = np.array([model.parameter(key).si for key in order])
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
