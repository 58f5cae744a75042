"""Forecasts of later poses: their errors count over what their fit expects, and a change is carried on."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model
from lrm_ident.residual.deployment.forecast_error import ForecastError, _Prediction, forecast_error
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

MEASURED, LATER = 120, 60


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


def forecast_and_truth(lab: Arm, offset: Array) -> tuple[ForecastError, float]:
    """What is expected of poses after those that a joint measured with these offsets (rad), and their RMS error (m)."""
    rng, count = np.random.default_rng(1), MEASURED + LATER
    q = rng.uniform(-0.8, 0.8, (count, lab.dof))
    turned = q.copy()
    turned[:, 2] += offset
    true = model_of(lab, effects_at(lab, "offsets"))
    tcp = solve_equilibrium(true, Poses(turned, np.zeros(count))).tcp + 0.3e-3 * rng.normal(size=(count, 3))
    poses = Poses(q, np.zeros(count), number=np.arange(1, count + 1))
    data = Measurements.of_tcp(poses, tcp, source=Source(arm=lab))
    rows = np.arange(count)
    seen, later = data.take(rows[:MEASURED]), data.take(rows[MEASURED:])
    fitted = fit_model(model_of(lab, effects_at(lab, "offsets")), seen, "identifiable", SQUARED).fit
    error = later.position_error(solve_equilibrium(fitted.model, later.poses))
    return forecast_error(fitted.model, seen, fitted.loss, fitted.stated), error_stats(error).rms


def test_a_change_at_a_constant_rate_is_carried_on(lab: Arm) -> None:
    """The deployed model stands for the middle of the session; as many poses later as were forecast it is further off
    than the fit to the first half was."""
    expected, true = forecast_and_truth(lab, np.linspace(0.0, 0.03, MEASURED + LATER))
    assert expected.followed is not None
    assert expected.followed.rms == pytest.approx(true, rel=0.1)


def test_an_arm_that_stays_as_it_is_has_no_forecast(lab: Arm) -> None:
    assert forecast_and_truth(lab, np.zeros(MEASURED + LATER))[0] == ForecastError()
