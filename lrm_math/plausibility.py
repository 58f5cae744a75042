"""The one place that decides whether a quantity is plausible in its unit, and what it would be in another one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

FAR = 5.0
"""Typical sizes of a parameter that no assembled arm exceeds, where nothing more is known of it."""


@dataclass(frozen=True)
class PlausibleSize:
    """Sizes that a quantity has on arms, in the unit of its key or column.

    Attributes:
        words: its name in a sentence. unit: of `low` and `high`, between which its size is plausible; zero always is.
        others: units in which it is often written by mistake: what one of them is in ours, and what to add.
        right: what would be right, in words; "": the plausible sizes.
    """

    words: str
    unit: str
    low: float
    high: float
    others: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    right: str = ""


@dataclass(frozen=True)
class ImplausibleValue:
    """A value that is not plausible: its index, what is wrong, and what would be right."""

    row: int
    what: str
    right: str


def times(**factors: float) -> Mapping[str, tuple[float, float]]:
    """Other units by what one of them is in ours."""
    return {unit: (factor, 0.0) for unit, factor in factors.items()}


def implausible_value(quantity: PlausibleSize, values: ArrayLike) -> ImplausibleValue | None:
    """The first value (N,) of no plausible size; None if all are plausible, zero or NaN."""
    sizes = np.abs(np.atleast_1d(np.asarray(values, dtype=np.float64)))
    bad = (sizes > 0.0) & ~((sizes >= quantity.low) & (sizes <= quantity.high)) & ~np.isnan(sizes)
    if not bad.any():
        return None
    row = int(np.argmax(bad))
    size = float(sizes[row])
    seems = [
        f"{unit} ({_figure(size * factor + add)} {quantity.unit})"
        for unit, (factor, add) in quantity.others.items()
        if quantity.low <= size * factor + add <= quantity.high
    ]
    what = f"{_figure(size)} {quantity.unit} is not plausible as {quantity.words}"
    right = quantity.right or f"{_figure(quantity.low)} to {_figure(quantity.high)} {quantity.unit}"
    return ImplausibleValue(row, what + (f": it looks like {' or '.join(seems)}" if seems else ""), right)


def _figure(value: float) -> str:
    return f"{value:.4g}" if value < 1e6 else f"{value:.15g}"


@dataclass(frozen=True)
class PlausibleEstimate:
    """Sizes of a fitted parameter (SI): what is `usual` on real arms, and the `largest` that physics allows."""

    usual: float
    largest: float

    def admits(self, value: float, error: float) -> bool:
        """Whether an estimate is not surely larger, by two standard errors."""
        return abs(value) - 2.0 * error <= self.largest
