"""What a verdict must not say: a tracker's scale is the arm's lengths, and outliers together are no accidents."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.distances import Distances
from lrm_ident.data.source import Source
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, build_report
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.report.text.residuals import scale_sentence
from lrm_ident.residual.scale_uncertainty import ScaleUncertainty, scale_left_open, scale_uncertainty
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.sweep import seeds
from tests.support.upright_arm import upright_measurements
from validation.synthetic import FormulaJoint

FRAME, SCALE = "measurement_frame@frame", 0.004
SD = 1e-4
STRING_AT = np.array([0.35, 0.0, 0.05])
"""m."""


def measured(arm: Arm, distances: int) -> Measurements:
    """A nominal arm, seen by a tracker that stretches z; the first so many poses also by a string."""
    rng, count = np.random.default_rng(1), 80
    poses = poses_of(rng.uniform(-1.4, 1.4, (count, arm.dof)))
    true = solve_equilibrium(model_of(arm, ()), poses).tcp
    tcp = true + SCALE * (true - true.mean(axis=0)) * [0.0, 0.0, 1.0] + SD * rng.normal(size=true.shape)
    data = Measurements.of_tcp(poses, tcp, SD, source=Source(arm=arm))
    if not distances:
        return data
    far = np.linalg.norm(true - STRING_AT, axis=1) + SD * rng.normal(size=count)
    far[distances:] = np.nan
    sd, (x, y, z) = np.full(count, SD), STRING_AT.tolist()
    return Measurements.of_tcp(poses, tcp, sd=sd, source=data.source).beside(Distances(far, sd, start=(x, y, z)))


def fitted(arm: Arm, data: Measurements) -> Fit:
    plain = model_of(arm, [effect for name in ("offsets", "compliance") for effect in effects_at(arm, name)])
    before = fit_identifiable(plain, data, plain.keys).fit.model
    return add_effects(before, data, effects_at(arm, FRAME))


def test_poses_alone_leave_the_scale_open_and_its_error_is_within_two_standard_errors(lab: Arm) -> None:
    fit = fitted(lab, measured(lab, 0))
    found = scale_uncertainty(fit)
    common = np.mean([fit.model.value(f"measurement_frame.frame.scale_{axis}_mm_per_m") for axis in "xyz"])
    assert abs(common - SCALE / 3.0) < 2.0 * found.sd
    assert found.sd > 5e-4
    assert "distance_mm" in scale_sentence(found)
    assert "mostly its prior (typical: 0.33 mm/m)" in scale_sentence(found), (
        "its interval misses a worse tracker's scale"
    )
    assert scale_left_open("measurement_frame@frame", fit) == found
    assert scale_left_open("frame_curve@frame", fit) is None  # said at the step that brought it, not again


def test_a_known_length_decides_it(lab: Arm) -> None:
    fit, alone = fitted(lab, measured(lab, 40)), scale_uncertainty(fitted(lab, measured(lab, 0)))
    found = scale_uncertainty(fit)
    assert alone is not None
    assert found is None or found.sd < 0.5 * alone.sd
    values = [fit.model.value(f"measurement_frame.frame.scale_{axis}_mm_per_m") for axis in "xyz"]
    assert values == pytest.approx([0.0, 0.0, SCALE], abs=1e-3)


def test_a_model_without_a_distorted_tracker_has_no_such_scale(lab: Arm) -> None:
    data = measured(lab, 0)
    plain = model_of(lab, effects_at(lab, "offsets"))
    assert scale_uncertainty(fit_identifiable(plain, data, plain.keys).fit) is None


def test_depth_alone_tells_the_lengths_and_the_verdict_says_what_that_supposes(lab: Arm) -> None:
    data = measured(lab, 0)
    plain = model_of(lab, [effect for name in ("offsets", "compliance") for effect in effects_at(lab, name)])
    before = fit_identifiable(plain, data, plain.keys).fit.model
    fit = add_effects(before, data, effects_at(lab, "depth_scale@frame"), (0.0, 0.0, np.pi / 2))
    along = np.sin(fit.model.value("depth_scale.frame.elevation_rad"))
    assert abs(along) > 0.95
    assert fit.model.value("depth_scale.frame.scale_mm_per_m") == pytest.approx(SCALE, abs=1e-3)
    assert scale_left_open("depth_scale@frame", fit) == ScaleUncertainty()
    assert scale_sentence(ScaleUncertainty()).startswith("taken as right across that direction: ")


NOISE = 3e-4


def diagnosed(model: Model, data: Measurements) -> DiagnosisReport:
    """The diagnosis of the arm, fitted to the data."""
    return build_report(diagnose(fit_identifiable(model, data, model.keys).fit.model, data))


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(1, 6))
def test_a_dead_band_that_is_left_out_is_said_with_its_place(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    joint, middle, half = int(rng.integers(2, 5)), rng.uniform(-0.3, 0.5), rng.uniform(0.12, 0.16)
    apart = f"q[{joint}] - {middle}"
    band = FormulaJoint(joint, -1.0, f"np.where(np.abs({apart}) < {half}, {apart}, 0.0)")
    report = diagnosed(*upright_measurements(tmp_path, seed, 300, NOISE, (band,)))
    assert len(report.diagnosis.outlier_distances) >= 5
    assert report.verdict not in ("nothing_missing", "noise_unknown")
    assert report.patterns.regimes[0].quantity.variable.symbol == f"q{joint}"
    assert set(report.diagnosis.outlier_distances) <= set(
        report.patterns.pose[report.patterns.regimes[0].rows].tolist()
    )
    squares = np.square([*report.diagnosis.outlier_distances.values()])
    all_poses = np.sqrt((squares.sum() + (300 - len(squares)) * report.held_out.rms**2) / 300)
    assert report.deployed.now.rms == pytest.approx(all_poses, rel=0.02), "the arm errs there, too, once deployed"
    assert report.held_out.rms < 0.8 * report.deployed.now.rms


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(1, 6))
def test_outliers_that_are_scattered_are_left_out_and_nothing_is_missing(tmp_path: Path, seed: int) -> None:
    model, data = upright_measurements(tmp_path, seed, 240, NOISE)
    rng = np.random.default_rng(seed)
    far = np.zeros((len(data), 3))
    far[rng.permutation(len(data))[:24]] = rng.normal(scale=0.015, size=(24, 3))
    report = diagnosed(model, data.with_tcp(data.tcp + far))
    assert report.diagnosis.outlier_distances
    assert not report.patterns.regimes
    assert report.deployed.now == report.held_out
    assert report.verdict == "nothing_missing"


def test_a_part_of_the_data_does_not_count_the_rest_as_left_out(tmp_path: Path) -> None:
    """Folds are parts; what was left out is remembered until then, through a change of frame too."""
    _, data = upright_measurements(tmp_path, 0, 240, NOISE)
    left = data.without([3, 5]).turned(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    assert left.complete.pose.tolist() == data.pose.tolist()
    assert np.array_equal(left.complete.tcp, data.tcp * [-1.0, -1.0, 1.0])
    part = left.take(np.arange(6))
    assert part.complete is part
