"""Regimes: intervals of an angle, the load or the order in which a model's residual is larger than elsewhere.

For every quantity an interval is chosen on one half of the poses, by the rank sum test of the residuals' sizes (Mann &
Whitney 1947), and tested on the other half; p values of many random halvings are aggregated (twice the median;
Meinshausen, Meier & Bühlmann 2009), and those of all quantities adjusted for false discovery under any dependence
(Benjamini & Yekutieli 2001). For poses that were left out as outliers, which are few, Kuiper's test (1960, with the
correction of Stephens 1970) shows whether an interval holds more of them than of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.residual.covariates import Covariate, covariates, levels
from lrm_ident.residual.significance import benjamini_yekutieli
from lrm_ident.residual.thresholds import FEWEST_IN_REGIME, LARGEST_REGIME, MIN_REGIME_RATIO, SIGNIFICANCE
from lrm_math.arrays import Array

HALVINGS, SEED, PARTS = 25, 0, 10
UNITS = {"angle": "°", "load": " g", "order": ""}
"""Kinds of the quantities whose intervals are tried, with the symbol of the unit."""
RankedRows = tuple[NDArray[np.bool_], NDArray[np.int64]]
"""Subset of the poses (N,), and the ranks of their residuals."""


@dataclass(frozen=True)
class Regime:
    """An interval of one quantity in which the residual is larger than elsewhere.

    Attributes:
        low, high: its ends in the quantity's unit; None where it reaches to the end of what was measured.
        poses, share: number of its poses, and their share (0 to 1) of the squared residual.
        inside, outside: RMS of the residual in it and elsewhere (m). p_value: adjusted.
    """

    quantity: Covariate
    low: float | None
    high: float | None
    poses: int
    share: float
    inside: float
    outside: float
    p_value: float

    @property
    def rows(self) -> NDArray[np.bool_]:
        """(N,), whether a pose lies in it."""
        values = self.quantity.shown
        above = np.ones(len(values), dtype=np.bool_) if self.low is None else values > self.low
        return np.asarray(above if self.high is None else above & (values < self.high))


def studentised_squares(residual: Array, columns: Array) -> Array:
    """(N,), squared residual (N, 3) of each pose over 1 − its mean leverage in a fit of columns (3 N, P)."""
    basis, singular, _ = np.linalg.svd(columns, full_matrices=False)
    # diagonal of the hat matrix U Uᵀ: how much of its own error a row's fit has followed
    leverage = (basis[:, singular > 1e-9 * singular.max(initial=0.0)] ** 2).sum(axis=1).reshape(-1, 3)
    return np.asarray((residual**2).sum(axis=1) / np.maximum(1.0 - leverage.mean(axis=1), 1e-3))


def find_regimes(data: Measurements, squares: Array) -> tuple[Regime, ...]:
    """The regimes in which squared residuals (N,) in m² are significantly larger than elsewhere, the clearest first."""
    quantities = [covariate for covariate in covariates(data, np.empty((len(data), 0))) if covariate.kind in UNITS]
    quantities.sort(key=lambda covariate: list(UNITS).index(covariate.kind))
    halves = _halves(data.repeat_of)
    if not quantities or min(int(half.sum()) for half in halves) < 2 * FEWEST_IN_REGIME:
        return ()
    ranked = [tuple((rows, _ranks(squares[rows])) for rows in (half, ~half)) for half in halves]
    adjusted = benjamini_yekutieli(
        {covariate.variable: _aggregated_p_value(_parts(covariate), ranked) for covariate in quantities}
    )
    regimes = [
        _regime(quantity, _best_interval(quantity, squares), squares, p_value)
        for quantity in sorted(quantities, key=lambda covariate: adjusted[covariate.variable])
        if (p_value := adjusted[quantity.variable]) < SIGNIFICANCE
    ]
    return tuple(regime for regime in regimes if regime.inside > MIN_REGIME_RATIO * regime.outside)


def outlier_regimes(data: Measurements, squares: Array, outliers: NDArray[np.bool_]) -> tuple[Regime, ...]:
    """Regimes that hold significantly more of the outliers than of the other poses, the clearest first.

    Args:
        squares: (N,), squared residuals (m²). outliers: (N,), which poses are outliers.
    """
    if not 0 < outliers.sum() < len(data):
        return ()
    quantities = {
        covariate.variable: covariate
        for covariate in covariates(data, np.empty((len(data), 0)))
        if covariate.kind in UNITS
    }
    tested = {variable: kuiper_interval(covariate.shown, outliers) for variable, covariate in quantities.items()}
    adjusted = benjamini_yekutieli({variable: p_value for variable, (p_value, _) in tested.items()})
    return tuple(
        _regime(quantities[variable], tested[variable][1], squares, adjusted[variable])
        for variable in sorted(adjusted, key=lambda variable: adjusted[variable])
        if adjusted[variable] < SIGNIFICANCE
    )


def kuiper_interval(values: Array, chosen: NDArray[np.bool_]) -> tuple[float, NDArray[np.bool_]]:
    """Kuiper's test of values (N,) for the `chosen` poses (N,) against the others: p value, and the poses (N,) in the
    interval in which the empirical distribution of the chosen ones exceeds that of the others most.

    Intervals that wrap around are left out, so the p value is conservative.
    """
    _, place = np.unique(values, return_inverse=True)
    count, others = int(chosen.sum()), int((~chosen).sum())
    # steps of the difference of both empirical distribution functions, at each distinct value
    ahead = np.bincount(place, chosen / count - ~chosen / others)
    ahead = np.concatenate([[0.0], np.cumsum(ahead)])
    # the largest rise from an earlier minimum: by how much an interval holds more of the chosen than of the others
    rise = ahead - np.minimum.accumulate(ahead)
    high = int(np.argmax(rise))
    low = int(np.argmin(ahead[: high + 1]))
    # sample size of a two-sample test, and Stephens' correction of the statistic for few samples
    effective = np.sqrt(count * others / (count + others))
    scaled_rise = (effective + 0.155 + 0.24 / effective) * rise[high]
    # Kuiper's series Q(λ) = 2 Σ (4 j²λ² − 1) exp(−2 j²λ²); below λ = 0.4 it is 1 to many digits and converges slowly
    terms = (2.0 * np.arange(1, 101) * scaled_rise) ** 2
    p_value = 2.0 * float(((terms - 1.0) * np.exp(-0.5 * terms)).sum()) if scaled_rise > 0.4 else 1.0
    return min(max(p_value, 0.0), 1.0), np.asarray((place >= low) & (place < high))


def _halves(repeat_of: NDArray[np.int64]) -> list[NDArray[np.bool_]]:
    """Random halves of the poses; repetitions of a pose stay together."""
    _, group = np.unique(repeat_of, return_inverse=True)
    count, rng = int(group.max()) + 1, np.random.default_rng(SEED)
    return [np.isin(group, rng.permutation(count)[: count // 2]) for _ in range(HALVINGS)]


def _aggregated_p_value(parts: NDArray[np.int64], ranked: Sequence[tuple[RankedRows, ...]]) -> float:
    """Twice the median of the halvings' p values (Meinshausen et al. 2009), each of one half's best interval in the
    other half."""
    from scipy.special import ndtr  # here: the words of a fit name regimes, and load no scipy

    p_values = []
    for half, other in ranked:
        z, allowed = _interval_scores(parts, *half)
        again, fair = _interval_scores(parts, *other)
        best = np.unravel_index(np.argmax(np.where(allowed, z, -np.inf)), z.shape)
        p_values.append(float(ndtr(-again[best])) if allowed[best] and fair[best] else 1.0)
    return min(1.0, 2.0 * float(np.median(p_values)))


def _ranks(values: Array) -> NDArray[np.int64]:
    """(N,), ranks from 1, the smallest first."""
    return np.argsort(np.argsort(values)) + 1


def _parts(quantity: Covariate) -> NDArray[np.int64]:
    """(N,), part of each pose: one for each level if there are few, else tenths of the poses; ties share a part."""
    distinct, level = levels(quantity.shown, 6)
    if len(distinct) <= PARTS:
        return level
    edges = np.unique(np.quantile(quantity.shown, np.linspace(0.0, 1.0, PARTS + 1)[1:-1]))
    return np.searchsorted(edges, quantity.shown, side="right")


def _interval_scores(
    parts: NDArray[np.int64], rows: NDArray[np.bool_], ranks: NDArray[np.int64]
) -> tuple[Array, NDArray[np.bool_]]:
    """z scores of the rank sums (Mann & Whitney 1947) of all intervals, and whether the size of each is allowed.

    Entry (i, j) of the (P + 1, P + 1) tables is of the interval of parts i to j − 1.
    """
    chosen, top = parts[rows], int(parts.max()) + 1
    # cumulative sums, so that every interval's count and rank sum is one difference
    count = np.concatenate([[0.0], np.cumsum(np.bincount(chosen, minlength=top))])
    total = np.concatenate([[0.0], np.cumsum(np.bincount(chosen, ranks, minlength=top))])
    n, inside = len(ranks), count[None, :] - count[:, None]
    allowed = (inside >= FEWEST_IN_REGIME) & (inside <= LARGEST_REGIME * n)
    # variance of a rank sum of k of n without ties: k (n − k)(n + 1)/12; its mean k (n + 1)/2
    spread = np.sqrt(np.where(allowed, inside * (n - inside) * (n + 1) / 12, 1.0))
    return (total[None, :] - total[:, None] - inside * (n + 1) / 2) / spread, allowed


def _best_interval(quantity: Covariate, squares: Array) -> NDArray[np.bool_]:
    """(N,), whether a pose lies in the interval of largest z score over all poses."""
    parts = _parts(quantity)
    z, allowed = _interval_scores(parts, np.ones(len(squares), dtype=np.bool_), _ranks(squares))
    low, high = np.unravel_index(np.argmax(np.where(allowed, z, -np.inf)), z.shape)
    return np.asarray((parts >= low) & (parts < high))


def _regime(quantity: Covariate, inside: NDArray[np.bool_], squares: Array, p_value: float) -> Regime:
    """Regime of the poses `inside` (N,), its ends midway to the next values outside."""
    values, total = quantity.shown, float(squares.sum())
    below, above = values[~inside & (values < values[inside].min())], values[~inside & (values > values[inside].max())]
    return Regime(
        quantity=quantity,
        low=float((below.max() + values[inside].min()) / 2) if len(below) else None,
        high=float((above.min() + values[inside].max()) / 2) if len(above) else None,
        poses=int(inside.sum()),
        share=float(squares[inside].sum()) / total,
        inside=float(np.sqrt(squares[inside].mean())),
        outside=float(np.sqrt(squares[~inside].mean())),
        p_value=p_value,
    )
