"""Regression of a residual field: hyperparameters, rank, coefficients and their covariance from what a model leaves.

Per axis y = F c + noise, with independent normal coefficients whose variances follow the spectral density of a
squared-exponential kernel with a length for each joint (Solin & Särkkä 2020). Lengths, signal and noise have the
largest marginal likelihood (Rasmussen & Williams 2006, Eq 5.8). The coefficients that carry most are kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve

from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import MARGIN, ResidualField, wave_numbers
from lrm_math.kinematics.poses import Poses

MOST_NUMBERS = 100
"""Numbers of a field in a model file: coefficients, and for each axis what it may be beyond the data."""
LENGTH_RANGE, SIGNAL_RANGE, NOISE_RANGE = (0.3, 10.0), (1e-3, 10.0), (1e-2, 2.0)
"""Bounds: in half widths of a joint's range; in RMS of the residual."""
START = (1.0, 1.0, 0.5)
MAX_ITERATIONS, TOLERANCE = 40, 1e-5
SERIES = np.arange(30.0)


@dataclass(frozen=True, eq=False)
class FieldPosterior:
    """A field's coefficients given residuals.

    Attributes:
        values: (P,), of all the field's parameters, zero of those that were not kept (m).
        kept: (K,), which were. covariance: (K, K), m². noise: (3,), standard deviation that it leaves, per axis (m).
        determined: effective number of coefficients (MacKay 1992): the part that the data determine, not the prior.
    """

    values: Array
    kept: NDArray[np.int64]
    covariance: Array
    noise: Array
    determined: float


def field_posterior(field: ResidualField, poses: Poses, residual: Array, weight: Array | None = None) -> FieldPosterior:
    """The posterior of a field over the range of its fit.

    Args:
        residual: (N, 3), measured − predicted TCP (m). weight: (N,), of the poses; None: all alike.
    """
    root = np.ones(len(poses)) if weight is None else np.sqrt(weight)
    functions = np.stack([np.broadcast_to(f, len(poses)) for f in field.functions(poses)], axis=1)
    F, y = functions * root[:, None], residual * root[:, None]
    waves = np.array(wave_numbers(field.arm.dof))
    axes = [AxisRegression.likeliest(F, column, waves) for column in y.T]
    energy = np.stack([axis.mean(np.arange(len(waves))) ** 2 for axis in axes]) * (F**2).sum(axis=0)
    most = min(MOST_NUMBERS - 3, energy.size)
    least = np.sort(energy.ravel())[-most]
    values, kept, blocks, determined = np.zeros(len(field.parameters)), list[int](), list[Array](), 0.0
    for number, (axis, share) in enumerate(zip(axes, energy, strict=True)):
        chosen, first = np.flatnonzero(share >= least), number * (len(waves) + 1)
        values[first + chosen] = axis.mean(chosen)
        kept += [*(first + chosen).tolist(), first + len(waves)]
        covariance = axis.covariance(chosen)
        blocks += [covariance, np.array([[axis.signal**2]])]
        determined += float((1.0 - np.diag(covariance) / axis.variance[chosen]).sum())
    return FieldPosterior(
        values, np.array(kept), block_diag(*blocks), np.array([axis.noise for axis in axes]), determined
    )


@dataclass(frozen=True, eq=False)
class AxisRegression:
    """Bayesian linear regression: FᵀF (M, M), Fᵀy (M,), prior `variance` (M,) of the coefficients, noise (m)."""

    gram: Array
    moment: Array
    variance: Array
    signal: float
    noise: float

    @staticmethod
    def likeliest(F: Array, y: Array, waves: Array) -> AxisRegression:
        """The regression of the largest marginal likelihood, searched by its gradient (L-BFGS-B; Byrd et al. 1995)."""
        from scipy.optimize import Bounds, minimize  # takes a quarter of a second to load

        unit, joints = float(np.sqrt((y**2).mean())) or 1.0, waves.shape[1]
        gram, moment, prior = F.T @ F, F.T @ (y / unit), _SpectralPrior(waves)
        lower, upper = np.log([*[LENGTH_RANGE] * joints, SIGNAL_RANGE, NOISE_RANGE]).T
        length, signal, noise = START
        found = minimize(
            _loss,
            np.log([*[length] * joints, signal, noise]),
            args=(gram, moment, float((y / unit) @ (y / unit)), len(y), prior),
            jac=True,
            bounds=Bounds(lower, upper),
            method="L-BFGS-B",
            options={"maxiter": MAX_ITERATIONS, "ftol": TOLERANCE},
        ).x
        variance = unit**2 * np.exp(prior.log_variance(found[:-1])[0])
        signal, noise = (unit * np.exp(found[-2:])).tolist()
        return AxisRegression(gram, unit * moment, variance, signal, noise)

    def mean(self, chosen: NDArray[np.int64]) -> Array:
        """Coefficients of some functions, without the others."""
        root = np.sqrt(self.variance[chosen])
        return np.asarray(root * cho_solve(self._whitened(chosen), root * self.moment[chosen]) / self.noise**2)

    def covariance(self, chosen: NDArray[np.int64]) -> Array:
        """(K, K), of these coefficients."""
        root = np.sqrt(self.variance[chosen])
        return np.asarray(root[:, None] * cho_solve(self._whitened(chosen), np.eye(len(chosen))) * root)

    def _whitened(self, chosen: NDArray[np.int64]) -> tuple[Array, bool]:
        root = np.sqrt(self.variance[chosen])
        part = root[:, None] * self.gram[np.ix_(chosen, chosen)] * root / self.noise**2
        factor, lower = cho_factor(part + np.eye(len(chosen)))
        return np.asarray(factor), bool(lower)


@dataclass(frozen=True, eq=False)
class _SpectralPrior:
    """Variances of coefficients: σ² Π exp(−½ (ℓ ω)²)/Z with ω = m π/2b of each joint; together they are σ²."""

    waves: Array

    def log_variance(self, hyper: Array) -> tuple[Array, Array]:
        """(M,) and its derivatives (M, n + 1) by the logarithms of n lengths (half widths of the range) and the
        signal."""
        length, step = np.exp(hyper[:-1]), np.pi / (2.0 * MARGIN)
        squares, series = (self.waves * step * length) ** 2, (SERIES[:, None] * step * length) ** 2
        density = np.exp(-0.5 * series)
        norm = density.sum(axis=0)
        slope = (density * series).sum(axis=0) / norm - squares
        value = 2.0 * hyper[-1] - (0.5 * squares + np.log(norm)).sum(axis=1)
        return value, np.column_stack([slope, np.full(len(value), 2.0)])


def _loss(
    hyper: Array, gram: Array, moment: Array, square: float, rows: int, prior: _SpectralPrior
) -> tuple[float, Array]:
    """Negative log marginal likelihood per row, but for a constant, and its gradient, by logarithms."""
    noise = float(np.exp(2.0 * hyper[-1]))
    log_variance, slope = prior.log_variance(hyper[:-1])
    root = np.exp(0.5 * log_variance)
    factor = cho_factor(root[:, None] * gram * root / noise + np.eye(len(root)))
    inverse = cho_solve(factor, np.eye(len(root)))
    whitened = inverse @ (root * moment) / noise
    mean = root * whitened
    value = 0.5 * (square - mean @ moment) / noise + np.log(np.diag(factor[0])).sum() + rows * hyper[-1]
    by_variance = 0.5 * (1.0 - np.diag(inverse) - whitened**2)
    left = square - 2.0 * (mean @ moment) + mean @ gram @ mean
    by_noise = rows - (len(root) - np.trace(inverse)) - left / noise
    return float(value) / rows, np.append(by_variance @ slope, by_noise) / rows
