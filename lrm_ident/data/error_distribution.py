"""How errors are distributed, beside the Gaussian of their mean and SD that the thesis draws (Figures 6.4 to 6.7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from lrm_math.arrays import Array

CRITICAL_1_PERCENT = 1.035  # of A*, mean and SD estimated (D'Agostino & Stephens 1986)


@dataclass(frozen=True)
class Distribution:
    """Errors against their Gaussian.

    Attributes:
        distance: (N,), sorted (m).
        mean, sd: of the errors (m).
        skewness: 0 for a Gaussian.
        misfit: Anderson–Darling A* for an unknown Gaussian; poses that resemble each other make it larger too.
        below_zero: part of the Gaussian that lies below zero, where no distance can be.
    """

    distance: Array
    mean: float
    sd: float
    skewness: float
    misfit: float
    below_zero: float

    @property
    def is_gaussian(self) -> bool:
        """Whether a Gaussian cannot be refused at the 1 % level."""
        return self.misfit < CRITICAL_1_PERCENT

    def quantile(self, part: float) -> float:
        """The error (m) that this part of the poses stays below."""
        return float(np.quantile(self.distance, part))

    def density(self, at: Array) -> Array:
        """The Gaussian's density (1/m)."""
        return np.asarray(stats.norm.pdf(at, self.mean, self.sd))

    def cumulative(self, at: Array) -> Array:
        """Part of the Gaussian below (0 to 1)."""
        return np.asarray(stats.norm.cdf(at, self.mean, self.sd))


def distribution(residual: Array) -> Distribution:
    """Of residuals (N, 3) in m; at least three, not all equally far."""
    distance = np.sort(np.linalg.norm(residual, axis=1))
    mean, sd, n = float(distance.mean()), float(distance.std(ddof=1)), len(distance)
    inside = stats.norm.cdf((distance - mean) / sd).clip(1e-16, 1 - 1e-16)
    weight = 2 * np.arange(1, n + 1) - 1
    raised = float(-n - np.mean(weight * (np.log(inside) + np.log1p(-inside[::-1]))))
    return Distribution(
        distance=distance,
        mean=mean,
        sd=sd,
        skewness=float(stats.skew(distance)),
        misfit=raised * (1 + 0.75 / n + 2.25 / n**2),
        below_zero=float(stats.norm.cdf(0.0, mean, sd)),
    )
