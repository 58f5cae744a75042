"""Regression of a residual field: hyperparameters, rank, coefficients and their covariance from a model's residual.

Per axis of the field y = F c + noise, with independent normal coefficients whose variances follow the spectral
densities of squared-exponential kernels: one of all joints with a length for each, and one of every joint alone with a
length and a signal of its own (Solin & Särkkä 2020; Duvenaud, Nickisch & Rasmussen 2011). Lengths, signals and noise
have the largest marginal likelihood (Rasmussen & Williams 2006, Eq 5.8). Backward elimination keeps the largest terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.linalg.lapack import dpotri

from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import MARGIN, ResidualField, wave_numbers
from lrm_math.kinematics.poses import Poses

MOST_NUMBERS = 100
"""Numbers of a field in a model file: coefficients, and for each axis the standard deviation far from the data."""
LENGTH_RANGE, LENGTH_ALONE_RANGE, SIGNAL_RANGE, NOISE_RANGE = (0.3, 10.0), (0.03, 10.0), (1e-3, 10.0), (1e-2, 2.0)
"""Bounds: in half widths of a joint's range; in RMS of the residual."""
START, START_ALONE = (1.0, 1.0, 0.5), (0.1, 0.3)
"""Length, signal and noise; length and signal of a joint alone: a search from long lengths misses short waves."""
MAX_ITERATIONS, TOLERANCE = 60, 1e-5
SERIES = np.arange(60.0)
NEGLIGIBLE = 1e-12
"""Ratio of a function's prior variance to the noise's below which a marginal likelihood leaves it out."""


@dataclass(frozen=True, eq=False)
class FieldPosterior:
    """Posterior of a field's coefficients given residuals.

    Attributes:
        values: (P,), posterior mean of all the field's parameters (m), zero where not kept.
        kept: (K,), numbers of those kept. covariance: (K, K), m². noise: (3,), standard deviation per axis (m).
        determined: effective number of coefficients (MacKay 1992).
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
    waves, (functions, resolved) = np.array(wave_numbers(field.arm.dof)), resolved_functions(field, poses)
    F, y = functions * root[:, None], field.along_axes(poses, residual) * root[:, None]
    axes = [AxisRegression.empirical_bayes(F, column, waves[resolved]) for column in y.T]
    values, kept, blocks, determined = np.zeros(len(field.parameters)), list[int](), list[Array](), 0.0
    for number, (axis, kept_of_axis) in enumerate(zip(axes, backward_elimination(axes, MOST_NUMBERS - 3), strict=True)):
        chosen, first = np.flatnonzero(kept_of_axis), number * (len(waves) + 1)
        values[first + resolved[chosen]] = axis.mean(chosen)
        # the last number of an axis is the field's standard deviation far from the data, known apart from the
        # coefficients
        kept += [*(first + resolved[chosen]).tolist(), first + len(waves)]
        covariance = axis.covariance(chosen)
        blocks += [covariance, np.array([[axis.signal**2]])]
        # MacKay's effective number: of each coefficient the share of its prior variance that the data removed
        determined += float((1.0 - np.diag(covariance) / axis.variance[chosen]).sum())
    return FieldPosterior(
        values, np.array(kept), block_diag(*blocks), np.array([axis.noise for axis in axes]), determined
    )


def resolved_functions(field: ResidualField, poses: Poses) -> tuple[Array, NDArray[np.int64]]:
    """(N, K), functions of a field below the Nyquist limit of the poses, and their numbers (K,): with fewer half waves
    of each joint than it has different angles (to 0.5°)."""
    levels = [len(np.unique(np.round(np.degrees(angle) / 0.5))) for angle in poses.q.T]
    resolved = np.flatnonzero((np.array(wave_numbers(field.arm.dof)) < levels).all(axis=1))
    return np.stack([np.broadcast_to(f, len(poses)) for f in field.functions(poses)], axis=1)[:, resolved], resolved


def backward_elimination(axes: Sequence[AxisRegression], most: int) -> NDArray[np.bool_]:
    """(axes, M), which coefficients are kept, `most` in all: those whose terms of the posterior mean are smallest go,
    half of the surplus at a time."""
    kept = np.ones((len(axes), len(axes[0].variance)), dtype=bool)
    while (surplus := int(kept.sum()) - most) > 0:
        squares = np.full(kept.shape, np.inf)
        for square, axis, which in zip(squares, axes, kept, strict=True):
            # mean square of a term over the poses is c² |f|² (up to 1/N); a term that is gone counts as infinitely
            # large, so that it is not chosen again
            square[which] = (axis.mean(np.flatnonzero(which)) ** 2) * np.diag(axis.gram)[which]
        kept.ravel()[np.argsort(squares.ravel())[: (surplus + 1) // 2]] = False
    return kept


@dataclass(frozen=True, eq=False)
class AxisRegression:
    """Bayesian linear regression: FᵀF (M, M), Fᵀy (M,), prior `variance` (M,) of the coefficients, noise (m)."""

    gram: Array
    moment: Array
    variance: Array
    signal: float
    noise: float

    @staticmethod
    def empirical_bayes(F: Array, y: Array, waves: Array) -> AxisRegression:
        """Hyperparameters of largest marginal likelihood (empirical Bayes), by L-BFGS-B (Byrd et al. 1995)."""
        from scipy.optimize import Bounds, minimize  # takes a quarter of a second to load

        # in RMS of the residual, so that start and bounds fit a residual of any size; 1.0 for a residual of zeros
        unit = float(np.sqrt((y**2).mean())) or 1.0
        gram, moment, prior = F.T @ F, F.T @ (y / unit), SpectralPrior(waves)
        start, lower, upper = np.log(prior.hyperparameters).T
        optimum = minimize(
            negative_log_likelihood,
            start,
            args=(gram, moment, float((y / unit) @ (y / unit)), len(y), prior),
            jac=True,
            bounds=Bounds(lower, upper),
            method="L-BFGS-B",
            options={"maxiter": MAX_ITERATIONS, "ftol": TOLERANCE},
        ).x
        variance = unit**2 * np.exp(prior.log_variance(optimum[:-1])[0])
        signal, noise = unit * prior.signal(optimum), unit * float(np.exp(optimum[-1]))
        return AxisRegression(gram, unit * moment, variance, signal, noise)

    def mean(self, chosen: NDArray[np.int64]) -> Array:
        """(K,), posterior mean of the coefficients of some functions, the others left out (m)."""
        root = np.sqrt(self.variance[chosen])
        return np.asarray(root * cho_solve(self._whitened(chosen), root * self.moment[chosen]) / self.noise**2)

    def covariance(self, chosen: NDArray[np.int64]) -> Array:
        """(K, K), posterior covariance of these coefficients (m²)."""
        root = np.sqrt(self.variance[chosen])
        return np.asarray(root[:, None] * cho_solve(self._whitened(chosen), np.eye(len(chosen))) * root)

    def _whitened(self, chosen: NDArray[np.int64]) -> tuple[Array, bool]:
        """Cholesky factor, for `cho_solve`, of the posterior precision in units of the prior, of some functions."""
        root = np.sqrt(self.variance[chosen])
        # S^½ (FᵀF/σ² + S⁻¹) S^½ = I + S^½ FᵀF S^½/σ² with S the prior's variances: no eigenvalue is below 1, so that
        # the factor exists however small a variance is (Rasmussen & Williams 2006, section 3.4.3)
        part = root[:, None] * self.gram[np.ix_(chosen, chosen)] * root / self.noise**2
        factor, lower = cho_factor(part + np.eye(len(chosen)))
        return np.asarray(factor), bool(lower)


@dataclass(frozen=True, eq=False)
class SpectralPrior:
    """Variances of coefficients: σ² Π exp(−½ (ℓ ω)²)/Z with ω = m π/2b of each joint; those of a kernel add up to σ².

    A function of one joint has a length and a signal of that joint alone, all others those of all joints.
    """

    waves: Array

    @cached_property
    def hyperparameters(self) -> Array:
        """(2 n + n + 2, 3), start and bounds of n lengths of all joints together, n of each alone, the signal of all
        together, those of each alone, and the noise."""
        (length, signal, noise), (length_alone, signal_alone), n = START, START_ALONE, self.waves.shape[1]
        together, alone = (length, *LENGTH_RANGE), (length_alone, *LENGTH_ALONE_RANGE)
        signals = [(signal, *SIGNAL_RANGE), *[(signal_alone, *SIGNAL_RANGE)] * n]
        return np.array([*[together] * n, *[alone] * n, *signals, (noise, *NOISE_RANGE)])

    @cached_property
    def indicators(self) -> tuple[Array, Array]:
        """(M, 2 n), whether a function depends on each length, and (M, 1 + n), on each signal; ones and zeros."""
        single = ((self.waves > 0).sum(axis=1) == 1)[:, None]
        alone, together = single & (self.waves > 0), np.broadcast_to(~single, self.waves.shape)
        return np.hstack([together, alone]).astype(float), np.hstack([~single, alone]).astype(float)

    def log_variance(self, hyper: Array) -> tuple[Array, Array]:
        """(M,), and derivatives (M, 3 n + 1) by the logarithms of lengths (half widths of the range) and signals."""
        lengths, signals = self.indicators
        length, step = np.exp(hyper[: lengths.shape[1]]), np.pi / (2.0 * MARGIN)
        # Σ_m exp(−½ (ℓ m Δω)²) normalises a kernel's variances to 1 along a joint; `series` are its exponents' terms.
        # Logarithm of a variance: 2 ln σ − Σ_joints (½ (ℓ ω)² + ln Z(ℓ)); slope by ln ℓ: E_Z[(ℓ m Δω)²] − (ℓ ω)²
        squares, series = (np.tile(self.waves, 2) * step * length) ** 2, (SERIES[:, None] * step * length) ** 2
        density = np.exp(-0.5 * series)
        norm = density.sum(axis=0)
        slope = lengths * ((density * series).sum(axis=0) / norm - squares)
        value = 2.0 * signals @ hyper[lengths.shape[1] :] - (lengths * (0.5 * squares + np.log(norm))).sum(axis=1)
        return value, np.column_stack([slope, 2.0 * signals])

    def signal(self, hyper: Array) -> float:
        """Standard deviation of the field, in RMS of the residual."""
        return float(np.sqrt(np.exp(2.0 * hyper[2 * self.waves.shape[1] : -1]).sum()))


def negative_log_likelihood(
    hyper: Array, gram: Array, moment: Array, square: float, rows: int, prior: SpectralPrior
) -> tuple[float, Array]:
    """Negative log marginal likelihood per row, but for a constant; its gradient by logarithms of hyperparameters."""
    noise = float(np.exp(2.0 * hyper[-1]))
    log_variance, slope = prior.log_variance(hyper[:-1])
    # functions whose prior is far below the noise change neither value nor gradient, and would only cost time
    acts = np.flatnonzero(np.exp(log_variance) * np.diag(gram) > NEGLIGIBLE * noise)
    root, gram, moment = np.exp(0.5 * log_variance[acts]), gram[np.ix_(acts, acts)], moment[acts]
    factor, _ = cho_factor(root[:, None] * gram * root / noise + np.eye(len(acts)))
    # dpotri gives one triangle of the inverse at half the cost of solving for all columns
    upper, _ = dpotri(factor)
    inverse = np.triu(upper) + np.triu(upper, 1).T
    whitened = inverse @ (root * moment) / noise
    mean = root * whitened
    # Rasmussen & Williams 2006, Eq 5.8 by the matrix inversion and determinant lemmas: yᵀK⁻¹y = (yᵀy − mᵀFᵀy)/σ² and
    # ½ ln|K| = Σ ln L_ii + N ln σ
    value = 0.5 * (square - mean @ moment) / noise + np.log(np.diag(factor)).sum() + rows * hyper[-1]
    # ∂/∂ln s² of the value: ½ (1 − [A⁻¹]_ii − (A⁻¹ S^½ Fᵀy/σ²)_i²), with A the whitened precision
    by_variance = 0.5 * (1.0 - np.diag(inverse) - whitened**2)
    # ∂/∂ln σ: N − effective number of coefficients − |y − F m|²/σ²
    remaining = square - 2.0 * (mean @ moment) + mean @ gram @ mean
    by_noise = rows - (len(acts) - np.trace(inverse)) - remaining / noise
    return float(value) / rows, np.append(by_variance @ slope[acts], by_noise) / rows
