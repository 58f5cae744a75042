"""Outliers that lie together are no accidents of the measurement: it is not said that nothing is missing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.robot_files.arm_text import template
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, build_report
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from validation.synthetic import (
    GroundTruth,
    HiddenEffect,
    JointLoad,
    base_displacement_to_deviations,
    even_schedule,
    measure,
    random_poses,
)
from validation.synthetic import load_arm as load_description
from validation.synthetic.generate import directions
from validation.synthetic.hidden_effect import at_joint

NOISE, COUNT, JOINTS, FEW = 3e-4, 240, 6, 5


@dataclass(frozen=True)
class DeadBand(HiddenEffect):
    """A potentiometer without a reading between two angles: the servo runs on to the nearer of them."""

    joint: int
    low_rad: float
    high_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        q = load.poses.q_rad[:, self.joint - 1]
        nearer = np.where(q < 0.5 * (self.low_rad + self.high_rad), self.low_rad, self.high_rad)
        return at_joint(self.joint, np.where((q > self.low_rad) & (q < self.high_rad), nearer - q, 0.0), load.tau_nm)


def measured(folder: Path, seed: int, hidden: tuple[HiddenEffect, ...]) -> Measurements:
    """Poses of an upright arm with errors everywhere."""
    file = folder / "arm.toml"
    file.write_text(template("upright"))
    arm, number = load_description(file), np.arange(1, COUNT + 1)
    truth = base_displacement_to_deviations(arm, GroundTruth.random(arm, seed, hidden))
    q, load, plan = random_poses(arm, COUNT, seed, floor_m=-1.0), np.zeros(COUNT), even_schedule(COUNT, JOINTS)
    tcp = measure(arm, truth, q, load, NOISE, seed, plan)
    poses = Poses(q, load, directions(q, np.zeros(JOINTS)), plan.time_s)
    return Measurements(poses, number, tcp, None, NOISE, number, file.with_suffix(".csv"), "")


def report_of(data: Measurements) -> DiagnosisReport:
    """The diagnosis of the nominal arm, fitted to the data."""
    model = nominal_model(load_arm(str(data.path.with_suffix(".toml"))))
    return build_report(diagnose(fit_identifiable(model, data, model.keys, required=()).fit.model, data))


@pytest.mark.parametrize("seed", range(6))
def test_a_dead_band_that_is_left_out_is_said_with_its_place(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    joint, middle, half = int(rng.integers(2, 5)), rng.uniform(-0.3, 0.5), rng.uniform(0.12, 0.16)
    report = report_of(measured(tmp_path, seed, (DeadBand(joint, middle - half, middle + half),)))
    if len(report.diagnosis.outlying) > FEW:
        assert report.verdict not in ("nothing_missing", "noise_unknown")
        assert report.left.regimes[0].name == f"q{joint}"
        assert set(report.diagnosis.outlying) <= set(report.left.pose[report.left.regimes[0].rows].tolist())


@pytest.mark.parametrize("seed", range(6))
def test_outliers_that_are_scattered_are_left_out_and_nothing_is_missing(tmp_path: Path, seed: int) -> None:
    data, rng = measured(tmp_path, seed, ()), np.random.default_rng(seed)
    far = np.zeros((COUNT, 3))
    far[rng.permutation(COUNT)[:24]] = rng.normal(scale=0.015, size=(24, 3))
    report = report_of(replace(data, tcp=data.tcp + far))
    assert report.diagnosis.outlying
    assert not report.left.regimes
    assert report.verdict == "nothing_missing"


def test_a_part_of_the_data_does_not_count_the_rest_as_left_out(tmp_path: Path) -> None:
    """Folds are parts; what was left out is remembered until then, through a change of frame too."""
    data = measured(tmp_path, 0, ())
    rest = data.without([3, 5]).turned(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    assert rest.whole.pose.tolist() == data.pose.tolist()
    assert np.array_equal(rest.whole.tcp, data.tcp * [-1.0, -1.0, 1.0])
    part = rest.take(np.arange(10))
    assert part.whole is part
