"""Forecasts of later poses: their errors count over what their fit expects."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.residual.deployment import forecast_error as module
from lrm_ident.residual.deployment.forecast_error import ForecastError, _Prediction, forecast_error
from lrm_math.errors import LrmError


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


@pytest.mark.parametrize(("kilograms", "forecast"), [(0.0, True), (0.13, False)])
def test_a_load_that_the_earlier_poses_did_not_bear_is_not_forecast(
    example_diagnosis: DiagnosisReport, monkeypatch: pytest.MonkeyPatch, kilograms: float, forecast: bool
) -> None:
    """A constant arm whose loads were measured one after the other was called changing: 2.26 mm for 0.17."""
    data, fit = example_diagnosis.diagnosis.data, example_diagnosis.diagnosis.fit
    payload = np.where(np.arange(len(data)) < 0.6 * len(data), 0.0, kilograms)
    loaded = replace(data, poses=replace(data.poses, payload=payload))
    tried = Mock(side_effect=LrmError("tried"))
    monkeypatch.setattr(module, "_predicted", tried)
    assert forecast_error(fit.model, loaded, fit.loss, fit.stated) == ForecastError()
    assert tried.called == forecast
