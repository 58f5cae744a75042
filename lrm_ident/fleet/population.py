"""The population that arms of one kind are drawn from: empirical Bayes (Morris 1983), parameter by parameter.

Arm i has parameters θ_i ~ N(μ, diag τ²), and its poses determine an information matrix Λ_i and a vector Λ_i θ̂_i: the
normal-normal hierarchical model with known standard errors, for all parameters together, so that what one arm cannot
tell apart its sisters may. μ and τ maximise the restricted marginal likelihood (Patterson & Thompson 1971) by
expectation-maximisation (Dempster, Laird & Rubin 1977; Laird & Ware 1982), accelerated (Varadhan & Roland 2008).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, stdtrit

from lrm_math.arrays import Array

ROUNDS, TOLERANCE = 100, 1e-3  # of log τ
SMALLEST, WIDEST = 1e-3, 3.0  # of τ, in typical sizes: what a model file's digits and the prior `vague` allow
LEVEL = 0.95
VAGUE_LOG_SD = 1.5
"""Standard deviation of log τ before any arm: without it a spread that no arm determines would have no interval."""


@dataclass(frozen=True, eq=False)
class ArmEvidence:
    """Information of one arm, in typical sizes, of the parameters of its model.

    Attributes:
        places: (P,), the parameters' numbers in the population. information: (P, P), Λ. along: (P,), Λ θ̂.
    """

    places: NDArray[np.int64]
    information: Array
    along: Array


@dataclass(frozen=True, eq=False)
class Population:
    """Means and spreads of Q parameters, in typical sizes.

    Attributes:
        mean: (Q,), μ. mean_covariance: (Q, Q), of its error. spread: (Q,), τ.
        freedom: (Q,), equivalent number of arms less one that determine τ, as if their parameters were known exactly.
        mean_freedom: (Q,), the same of the mean's error: effective number of arms (Kish 1965) less one.
        arms: (Q,), how many have the parameter.
    """

    mean: Array
    mean_covariance: Array
    spread: Array
    freedom: Array
    mean_freedom: Array
    arms: Array

    @property
    def mean_error(self) -> Array:
        """(Q,), standard error of each mean."""
        return np.asarray(np.sqrt(np.diag(self.mean_covariance)))

    @property
    def mean_interval(self) -> tuple[Array, Array]:
        """95 % interval of each mean, by Student's t."""
        half = self.mean_error * stdtrit(np.maximum(self.mean_freedom, 1.0), 0.5 + LEVEL / 2)
        return self.mean - half, self.mean + half

    @property
    def spread_interval(self) -> tuple[Array, Array]:
        """95 % interval of each spread (χ² with its freedom), within what a spread may be."""
        freedom = np.maximum(self.freedom, 0.1)
        low, high = (np.sqrt(freedom / chdtri(freedom, tail)) for tail in ((1 - LEVEL) / 2, (1 + LEVEL) / 2))
        return self.spread * low, np.minimum(self.spread * high, WIDEST)

    @property
    def predictive_covariance(self) -> Array:
        """(Q, Q), of a new arm's parameters about the mean: spreads and the errors of the means.

        What no arm can tell apart has large errors that are strongly correlated: their combinations are well known.
        """
        return np.diag(self.spread**2) + self.mean_covariance


def fit_population(arms: Sequence[ArmEvidence], count: int) -> Population:
    """Mean and spread of `count` parameters; one that no arm has is zero with the widest spread."""
    stacked = _stacked(arms, count)
    many = stacked.present.sum(axis=0).astype(np.float64)
    spread = np.exp(_log_spreads(stacked, many))
    mean, error, _, precisions = _expectation(stacked, spread)
    diagonals = np.einsum("nii->ni", precisions)
    effective = diagonals.sum(axis=0) ** 2 / np.maximum((diagonals**2).sum(axis=0), 1e-300)
    freedom = _freedom(precisions, spread, many)
    return Population(mean, error, spread, freedom, np.maximum(effective - 1.0, 0.0), many)


def _log_spreads(stacked: _Stacked, many: Array) -> Array:
    """(Q,), log τ: two steps of expectation-maximisation, an extrapolation along them, and a step from there, until a
    step changes nothing. Alone the steps would creep where the arms hardly determine a spread."""

    def step(log: Array) -> Array:
        squares = _expectation(stacked, np.exp(log))[2]
        new = np.where(many > 0, np.sqrt(squares / np.maximum(many, 1)), WIDEST)
        return np.asarray(np.log(np.clip(new, SMALLEST, WIDEST)))

    log: Array = np.zeros(len(many))
    for _ in range(ROUNDS):
        first = step(log)
        second = step(first)
        once, twice = first - log, second - first
        if np.abs(twice).max(initial=0.0) < TOLERANCE:
            return second
        # Steplength S3 of Varadhan & Roland 2008, without its sign: |r| / |v|, r the step, v its change
        length = max(1.0, float(np.linalg.norm(once) / np.linalg.norm(twice - once)))
        far = log + 2.0 * length * once + length**2 * (twice - once)
        log = step(np.clip(far, np.log(SMALLEST), np.log(WIDEST)))
    return log


@dataclass(frozen=True, eq=False)
class _Stacked:
    """All n arms on all Q parameters, zero where an arm has none: `information` (n, Q, Q), the others (n, Q)."""

    information: Array
    along: Array
    present: NDArray[np.bool_]


def _stacked(arms: Sequence[ArmEvidence], count: int) -> _Stacked:
    out = _Stacked(
        np.zeros((len(arms), count, count)), np.zeros((len(arms), count)), np.zeros((len(arms), count), dtype=np.bool_)
    )
    for number, arm in enumerate(arms):
        out.information[number][np.ix_(arm.places, arm.places)] = arm.information
        out.along[number, arm.places], out.present[number, arm.places] = arm.along, True
    return out


def _expectation(stacked: _Stacked, spread: Array) -> tuple[Array, Array, Array, Array]:
    """Expectation at these spreads: μ, its covariance, the expected sum of (θ_i − μ)² for each parameter, and each
    arm's precision of μ (n, Q, Q)."""
    inverse = spread**-2  # diagonal of T⁻¹, T = diag τ²
    covariance = np.linalg.inv(stacked.information + np.diag(inverse))  # C = (Λ + T⁻¹)⁻¹, of θ_i where μ is known
    # M = (Λ⁻¹ + T)⁻¹ = T⁻¹ − T⁻¹ C T⁻¹ = T⁻¹ C Λ, also where Λ is singular (Woodbury 1950)
    precision = np.diag(inverse) - inverse[:, None] * covariance * inverse
    error = np.asarray(np.linalg.inv(np.eye(len(spread)) / WIDEST**2 + precision.sum(axis=0)))
    mean: Array = error @ (inverse * np.einsum("nij,nj->ni", covariance, stacked.along)).sum(axis=0)
    # E(θ_i) − μ, and its variance: that of θ_i, and what the error of μ adds through d(E(θ_i) − μ)/dμ = C T⁻¹ − I
    deviation = np.einsum("nij,nj->ni", covariance, stacked.along + inverse * mean) - mean
    lever = covariance * inverse - np.eye(len(spread))
    unsure = np.einsum("nii->ni", covariance) + ((lever @ error) * lever).sum(axis=2)
    squares = np.where(stacked.present, deviation**2 + unsure, 0.0).sum(axis=0)
    return mean, error, squares, precision


def _freedom(precisions: Array, spread: Array, many: Array) -> Array:
    """Degrees of freedom of each spread: 2 τ⁴ over the variance of τ², less the part that the mean takes.

    Fisher information of the marginal likelihood: ½ Σ M∘M.
    """
    information = 0.5 * (precisions**2).sum(axis=0)
    # Of log τ, as dτ²/dlog τ = 2 τ²; a sample deviation of ν degrees of freedom has var(log τ) = 1 / (2 ν)
    by_log = 4.0 * information * np.outer(spread**2, spread**2) + np.eye(len(spread)) / VAGUE_LOG_SD**2
    variance = np.diag(np.linalg.inv(by_log))
    return np.asarray(0.5 / variance * np.where(many > 1, 1.0 - 1.0 / np.maximum(many, 1), 0.0))
