"""Distribution of TCP errors beside a Gaussian (thesis Figures 6.4–6.7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from lrm_math.arrays import Array

CRITICAL_1_PERCENT = 1.035  # of A*, mean and SD estimated (D'Agostino & Stephens 1986)


def norms_mm(residual: Array) -> Array:
    """(N,), length of each row of a residual (N, 3) in m, in mm."""
    return np.asarray(np.linalg.norm(residual, axis=1) * 1e3)


@dataclass(frozen=True)
class ErrorDistribution:
    """Errors, and the Gaussian of their mean and SD.

    Attributes:
        distance: (N,), sorted (m).
        mean, sd: of the errors (m).
        skewness: 0 for a Gaussian.
        misfit: Anderson–Darling statistic A*, mean and SD estimated; correlated poses enlarge it too.
        below_zero: probability of a negative distance under the Gaussian.
    """

    distance: Array
    mean: float
    sd: float
    skewness: float
    misfit: float
    below_zero: float

    @property
    def is_gaussian(self) -> bool:
        """Whether the Anderson–Darling test does not reject a Gaussian at the 1 % level."""
        return self.misfit < CRITICAL_1_PERCENT

    def quantile(self, part: float) -> float:
        """Quantile of the errors (m)."""
        return float(np.quantile(self.distance, part))

    def density(self, at: Array) -> Array:
        """Density of the Gaussian (1/m)."""
        return np.asarray(np.exp(-0.5 * ((at - self.mean) / self.sd) ** 2) / (self.sd * np.sqrt(2.0 * np.pi)))

    def cumulative(self, at: Array) -> Array:
        """Part of the Gaussian below (0 to 1)."""
        return _gaussian_cdf((at - self.mean) / self.sd)


def error_distribution(residual: Array) -> ErrorDistribution:
    """Distribution of the norms of residuals (N, 3) in m; at least three, not all equal."""
    distance = np.sort(np.linalg.norm(residual, axis=1))
    mean, sd, n = float(distance.mean()), float(distance.std(ddof=1)), len(distance)
    cumulative = _gaussian_cdf((distance - mean) / sd).clip(1e-16, 1 - 1e-16)
    weight = 2 * np.arange(1, n + 1) - 1
    a_squared = float(-n - np.mean(weight * (np.log(cumulative) + np.log1p(-cumulative[::-1]))))
    return ErrorDistribution(
        distance=distance,
        mean=mean,
        sd=sd,
        skewness=float(np.mean((distance - mean) ** 3) / np.mean((distance - mean) ** 2) ** 1.5),
        misfit=a_squared * (1 + 0.75 / n + 2.25 / n**2),
        below_zero=float(_gaussian_cdf(np.array(-mean / sd))),
    )


def _gaussian_cdf(z: Array) -> Array:
    return np.asarray(ndtr(z))
