"""Outliers that lie together are no accidents of the measurement: it is not said that nothing is missing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, build_report
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_math.model.model import Model
from tests.support.sweep import seeds
from tests.support.upright_arm import upright_measurements
from validation.synthetic.hidden_joints import DeadBand

NOISE = 3e-4


def diagnosed(model: Model, data: Measurements) -> DiagnosisReport:
    """The diagnosis of the arm, fitted to the data."""
    return build_report(diagnose(fit_identifiable(model, data, model.keys).fit.model, data))


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(1, 6))
def test_a_dead_band_that_is_left_out_is_said_with_its_place(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    joint, middle, half = int(rng.integers(2, 5)), rng.uniform(-0.3, 0.5), rng.uniform(0.12, 0.16)
    band = DeadBand(joint, middle, half)
    report = diagnosed(*upright_measurements(tmp_path, seed, 300, NOISE, (band,)))
    assert len(report.diagnosis.outlier_distances) >= 5
    assert report.verdict not in ("nothing_missing", "noise_unknown")
    assert report.patterns.regimes[0].name == f"q{joint}"
    assert set(report.diagnosis.outlier_distances) <= set(
        report.patterns.pose[report.patterns.regimes[0].rows].tolist()
    )


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(1, 6))
def test_outliers_that_are_scattered_are_left_out_and_nothing_is_missing(tmp_path: Path, seed: int) -> None:
    model, data = upright_measurements(tmp_path, seed, 240, NOISE)
    rng = np.random.default_rng(seed)
    far = np.zeros((len(data), 3))
    far[rng.permutation(len(data))[:24]] = rng.normal(scale=0.015, size=(24, 3))
    report = diagnosed(model, replace(data, tcp=data.tcp + far))
    assert report.diagnosis.outlier_distances
    assert not report.patterns.regimes
    assert report.verdict == "nothing_missing"


def test_a_part_of_the_data_does_not_count_the_rest_as_left_out(tmp_path: Path) -> None:
    """Folds are parts; what was left out is remembered until then, through a change of frame too."""
    _, data = upright_measurements(tmp_path, 0, 240, NOISE)
    left = data.without([3, 5]).turned(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    assert left.complete.pose.tolist() == data.pose.tolist()
    assert np.array_equal(left.complete.tcp, data.tcp * [-1.0, -1.0, 1.0])
    part = left.take(np.arange(6))
    assert part.complete is part
