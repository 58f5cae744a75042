"""F tests, and adjustment of p values for multiple tests under any dependence."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TypeVar

Tested = TypeVar("Tested", bound=Hashable)


def f_test_p_value(before: float, after: float, rank: int, degrees_of_freedom: int) -> float:
    """p value of the F test of `rank` further parameters, from the residual sums of squares before and after."""
    from scipy.special import fdtrc  # here: the words of a fit name regimes, and load no scipy

    rest = max(degrees_of_freedom - rank, 1)
    return float(fdtrc(rank, rest, (before - after) / rank / (after / rest))) if after > 0 else 0.0


def yekutieli_factor(m: int) -> float:
    """Factor m · Σ 1/k of the smallest of m p values in the procedure of Benjamini and Yekutieli (2001)."""
    return m * sum(1.0 / k for k in range(1, m + 1))


def benjamini_yekutieli(p_values: Mapping[Tested, float]) -> dict[Tested, float]:
    """p values adjusted for their number under any dependence (Benjamini & Yekutieli 2001)."""
    adjusted: dict[Tested, float] = {}
    smallest, factor = 1.0, yekutieli_factor(len(p_values))
    for rank, name in reversed(list(enumerate(sorted(p_values, key=lambda name: p_values[name]), start=1))):
        smallest = min(smallest, p_values[name] * factor / rank)
        adjusted[name] = smallest
    return adjusted
