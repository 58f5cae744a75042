"""Forecasts of later poses: their errors count over what their fit expects."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_ident.residual.deployment.forecast_error import _Prediction


def test_errors_are_whitened_by_the_covariance_of_noise_and_parameters() -> None:
    """The squares add up to Mahalanobis' distance, and to the count of the errors where these are as expected."""
    rng = np.random.default_rng(0)
    spread, noise, count = 1e-3 * rng.normal(size=(60, 7)), 4e-4, 4000
    V = noise**2 * np.eye(60) + spread @ spread.T
    drawn = rng.multivariate_normal(np.zeros(60), V, size=count)
    predictions = [_Prediction(e.reshape(20, 3), e.reshape(20, 3), spread, noise) for e in drawn]
    squares = np.array([one.squares(one.followed, noise) for one in predictions])
    assert squares[0].sum() == pytest.approx(drawn[0] @ np.linalg.solve(V, drawn[0]))
    assert squares.mean(axis=0) == pytest.approx(3.0, rel=0.08)
    assert np.corrcoef(squares.T)[0, 1:] == pytest.approx(0.0, abs=0.1)
