"""Bounds of motions that a diagnosis does not show: they cover what a hidden effect adds beyond the fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.error_stats import error_stats
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model
from lrm_ident.report.diagnosis.conclusion import conclude
from lrm_math.model.model import Model
from tests.support.sweep import seeds, soak
from tests.support.upright_arm import upright_measurements
from validation.synthetic import EccentricShaft, FrictionLag, HiddenEffect, SoftPlay

pytestmark = pytest.mark.long

POSES, NOISE = 80, 1e-3
HIDDEN: dict[str, HiddenEffect] = {
    "backlash@joint2": SoftPlay(2, 0.006, 0.04),
    "eccentricity@joint4": EccentricShaft(4, 0.01, 0.5),
    "hysteresis@joint3": FrictionLag(3, 0.01, 0.01),
}


def beyond_the_fit(folder: Path, seed: int, hidden: HiddenEffect) -> float:
    """RMS (m) of what a fit leaves of the same arm without noise."""
    model, data = upright_measurements(folder, seed, POSES, 1e-9, (hidden,))
    exact: Model = fit_model(model, data, "identifiable", SQUARED).fit.model
    found = fit_model(exact, data, "identifiable", SQUARED).fit
    return error_stats(found.residual).rms


@pytest.mark.slow
@pytest.mark.parametrize("name", ["backlash@joint2", *soak("eccentricity@joint4", "hysteresis@joint3")])
def test_bounds_cover_the_motion_that_a_hidden_effect_adds(tmp_path: Path, name: str) -> None:
    covered, shares = 0, []
    arms = seeds(2, 20)
    for seed in arms:
        model, data = upright_measurements(tmp_path, seed, POSES, NOISE, (HIDDEN[name],))
        fitted = fit_model(model, data, "identifiable", SQUARED).fit
        bound = diagnose(fitted.model, data).motion_bounds[name]
        true = beyond_the_fit(tmp_path, seed, HIDDEN[name])
        covered += true <= bound
        shares.append(true / bound)
    assert covered >= 0.9 * len(arms)  # 95 % or more
    assert np.median(shares) > 0.1  # and they are no bounds that anything would keep


def test_a_quiet_diagnosis_says_how_much_may_hide(tmp_path: Path) -> None:
    model, data = upright_measurements(tmp_path, 3, POSES, NOISE)
    report = build_report(diagnose(fit_model(model, data, "identifiable", SQUARED).fit.model, data))
    assert report.verdict == "nothing_missing"
    largest, *others = report.diagnosis.motion_bounds.values()
    assert all(bound <= largest for bound in others)
    assert dict(conclude(report).facts)["hidden at most"].startswith(f"{largest * 1e3:.2f} mm RMS")
