"""Marginal likelihood of a residual field: its value against a dense Gaussian, its gradient against differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.fitting.field.regression import SpectralPrior, negative_log_likelihood
from lrm_math.arrays import Array

ROWS, STEP = 40, 1e-5
WAVES = np.array([(i, j) for i in range(5) for j in range(5)])


def data_of(seed: int, scale: float) -> tuple[Array, Array, SpectralPrior, Array]:
    """(N, M) functions, (N,) values, the prior of their coefficients, and hyperparameters (logarithms)."""
    rng, prior = np.random.default_rng(seed), SpectralPrior(WAVES)
    hyper = np.log(prior.hyperparameters[:, 0]) + rng.normal(0.0, scale, len(prior.hyperparameters))
    return rng.normal(size=(ROWS, len(WAVES))), rng.normal(size=ROWS), prior, hyper


def loss(F: Array, y: Array, prior: SpectralPrior, hyper: Array) -> tuple[float, Array]:
    return negative_log_likelihood(hyper, F.T @ F, F.T @ y, float(y @ y), len(y), prior)


@given(st.integers(0, 10**6), st.floats(0.0, 1.0))
def test_it_is_that_of_a_dense_gaussian_and_its_gradient_is_its_slope(seed: int, scale: float) -> None:
    F, y, prior, hyper = data_of(seed, scale)
    noise = np.exp(2.0 * hyper[-1])
    dense = F @ np.diag(np.exp(prior.log_variance(hyper[:-1])[0])) @ F.T + noise * np.eye(ROWS)
    expected = 0.5 * (y @ np.linalg.solve(dense, y) + np.linalg.slogdet(dense)[1])
    value, gradient = loss(F, y, prior, hyper)
    assert ROWS * value == pytest.approx(expected, rel=1e-8, abs=1e-8)
    moved = STEP * np.eye(len(hyper))
    slopes = [(loss(F, y, prior, hyper + d)[0] - loss(F, y, prior, hyper - d)[0]) / (2.0 * STEP) for d in moved]
    np.testing.assert_allclose(gradient, slopes, rtol=1e-5, atol=1e-7)


def test_functions_that_long_lengths_leave_nothing_of_change_nothing() -> None:
    """All lengths at five half widths: every function but a few has a variance below round-off."""
    F, y, prior, hyper = data_of(1, 0.0)
    hyper[:4] = np.log(5.0)
    variance = np.exp(prior.log_variance(hyper[:-1])[0])
    few = variance > 1e-8 * variance.max()
    assert few.sum() < len(WAVES) / 2
    kept = np.where(few, F, 0.0)
    assert loss(F, y, prior, hyper)[0] == pytest.approx(loss(kept, y, prior, hyper)[0], abs=1e-5)
