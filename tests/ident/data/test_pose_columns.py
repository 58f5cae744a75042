"""Columns beside positions: scatter, covariance, orientation, joint feedback, gravity; bad ones in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lrm_ident.data.measurement_file.load import load_measurements, load_poses
from lrm_ident.data.measurement_file.write import csv_text, measurements_csv, quantity_columns
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.encoder_readings import EncoderReadings
from lrm_ident.data.observations.orientations import Orientations
from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.reason import ReasonKind
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from lrm_math.model.reading import Reading
from lrm_math.model.sensed import encoder_angles, tool_rotation
from tests.conftest import TABLE_B2
from tests.support.commands import stdout_of
from tests.support.table_cells import with_cell

SD, TURN_SD, FEEDBACK_SD = 4e-4, 2e-3, 4e-4


def hidden(arm: Arm, **effects: float) -> Model:
    """SO-101 with errors of assembly, springs, and effects `effect__place__parameter`."""
    names = ["offsets", "compliance", *dict.fromkeys(name.rsplit("__", 1)[0].replace("__", "@") for name in effects)]
    model = model_of(arm, [effect for name in names for effect in effects_at(arm, name)])
    rng = np.random.default_rng(3)
    values = {k: float(rng.normal(0, 0.1) * p.typical) for k, p in zip(model.keys, model.parameters, strict=True)}
    values |= {key: abs(value) for key, value in values.items() if key.startswith("compliance")}
    values = {k: v for k, v in values.items() if k.split(".")[0] in ("offsets", "compliance") and "base.k" not in k}
    return model_of(arm, model.effects, values | {k.replace("__", "."): v for k, v in effects.items()})


def measured(model: Model, poses: int, seed: int, covariance: Array | None = None) -> Measurements:
    """Positions, orientations and feedback with noise of the covariance (6, 6), m and rad."""
    rng = np.random.default_rng(seed)
    limits = np.array([(joint.lower, joint.upper) for joint in model.arm.joints]) * 0.8
    equilibrium = solve_equilibrium(model, poses_of(rng.uniform(*limits.T, (poses, model.arm.dof))))
    C = np.diag([SD**2] * 3 + [TURN_SD**2] * 3) if covariance is None else covariance
    error = rng.multivariate_normal(np.zeros(6), C, poses)
    every = np.broadcast_to(C, (poses, 6, 6))
    turned = Rotation.from_rotvec(error[:, 3:]).as_matrix() @ tool_rotation(equilibrium)
    read = encoder_angles(equilibrium) + rng.normal(0, FEEDBACK_SD, (poses, model.arm.dof))
    data = Measurements.of_tcp(equilibrium.poses, equilibrium.tcp + error[:, :3])
    return data.with_positions(replace(data.positions, blocks=every[:, :3, :3])).beside(
        Orientations(turned, blocks=every[:, 3:, 3:], cross=every[:, 3:, :3]),
        EncoderReadings(read, np.full(poses, FEEDBACK_SD)),
    )


def positions_only(data: Measurements) -> Measurements:
    return replace(data, observations=(data.positions,))


def alike(data: Measurements) -> Measurements:
    """Positions with one standard deviation each."""
    positions = data.positions
    return data.with_positions(replace(positions, sd=positions.rms_sd, blocks=None))


def fitted(model: Model, data: Measurements) -> Fit:
    return fit_model(model, data, "identifiable", SQUARED).fit


def test_written_and_read_again(so101: Arm, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    root = np.diag([4e-4, 3e-4, 2e-3, 1e-3, 2e-3, 3e-3]) @ (np.eye(6) + 0.2 * rng.normal(size=(6, 6)))
    data = measured(hidden(so101), 30, 1, root @ root.T)
    _, orientations, feedback = data.observations
    orientations.values[3], feedback.values[4, 2] = np.nan, np.nan
    path = tmp_path / "poses.csv"
    path.write_text(measurements_csv(data))
    path.with_suffix(".toml").write_text(
        f'schema = "lrm/measurements/1"\nfeedback_sd_deg = {float(np.degrees(FEEDBACK_SD))!r}\n'
    )
    again = load_measurements(path, so101)
    equilibrium = solve_equilibrium(hidden(so101), again.poses)
    np.testing.assert_allclose(again.residual(equilibrium), data.residual(equilibrium), atol=1e-8)
    np.testing.assert_allclose(again.whitening.root, data.whitening.root, rtol=1e-5, atol=1e-3)
    assert again.whitening.measured[3] == data.whitening.measured[3] == 3 + 5
    assert again.whitening.measured[4] == 6 + 4


def test_encoders_that_count_from_0_to_360_deg_read_the_turn_of_the_command(so101: Arm, tmp_path: Path) -> None:
    path, again = tmp_path / "plain.csv", []
    plain = measurements_csv(measured(hidden(so101), 12, 1)).splitlines()
    header = plain[0].split(",")
    turned = [line.split(",") for line in plain[1:]]
    for row in turned:
        for j in (header.index(f"q{i}_meas_deg") for i in range(1, so101.dof + 1)):
            row[j] = repr(float(row[j]) % 360.0)
    for rows in (plain[1:], [",".join(row) for row in turned]):
        path.write_text("\n".join([plain[0], *rows]) + "\n")
        path.with_suffix(".toml").write_text('schema = "lrm/measurements/1"\nfeedback_sd_deg = 0.1\n')
        (feedback,) = load_measurements(path, so101).of(EncoderReadings)
        again.append(feedback.values)
    np.testing.assert_allclose(again[1], again[0], atol=1e-9)


def test_scatter_of_positions_alone(so101: Arm, tmp_path: Path) -> None:
    """A covariance without an orientation weighs the positions, along the axes that it is read in."""
    C = np.diag([3e-4, 4e-4, 3e-3, 1.0, 1.0, 1.0]) ** 2
    data = positions_only(measured(hidden(so101), 12, 1, C))
    path = tmp_path / "scatter.csv"
    path.write_text(measurements_csv(data))
    plain, turned = (load_measurements(path, so101, Reading(axes=axes)) for axes in ("x,y,z", "z,y,-x"))
    np.testing.assert_allclose(plain.whitening.root, data.whitening.root, rtol=1e-5)
    np.testing.assert_allclose(1.0 / np.diag(turned.whitening.root[0]), [3e-3, 4e-4, 3e-4], rtol=1e-5)
    assert turned.sd == pytest.approx(plain.sd)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("cxx_mm2", -1.0, "not positive definite"),
        ("qw", 3.0, "length is not one"),
        ("cyy_mm2", None, "no column cyy_mm2"),
        ("cxx_mm2", "", "the cell is empty"),
        ("q3_meas_deg", None, "no column q3_meas_deg"),
    ],
)
def test_bad_columns(so101: Arm, tmp_path: Path, column: str, value: float | str | None, words: str) -> None:
    text = with_cell(measurements_csv(measured(hidden(so101), 12, 1)), column, value)
    (path := tmp_path / "bad.csv").write_text(text)
    with pytest.raises(FileError, match=words):
        load_measurements(path, so101)


def test_unstated_parts_are_kept_but_not_used(so101: Arm, tmp_path: Path) -> None:
    path = tmp_path / "plain.csv"
    positions, orientations, feedback = measured(hidden(so101), 12, 1).observations
    plain = [replace(one, sd=None, blocks=None, cross=0.0) for one in (positions, orientations)]
    data = replace(measured(hidden(so101), 12, 1), observations=(*plain, feedback))
    path.write_text(measurements_csv(data))
    again = load_measurements(path, so101)
    assert len(again.observations) == 1
    assert sum("not used" in notice for notice in again.source.notices) == 2


def test_a_round_covariance_is_a_standard_deviation(so101: Arm) -> None:
    truth = hidden(so101)
    data = positions_only(measured(truth, 60, 2))
    plain = alike(data)
    start = replace(truth, free=("compliance.joint2.k_rad_per_Nm", "offsets.joint3.theta_rad", "offsets.tool.x_mm"))
    one, other = fit(start, data), fit(start, plain)
    np.testing.assert_allclose(one.model.values, other.model.values, atol=1e-12)
    np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-8)
    assert one.sigma == pytest.approx(other.sigma, rel=1e-9)


@pytest.mark.slow
def test_depth_that_is_poorly_measured_is_weighted_down(so101: Arm) -> None:
    """The covariance makes the tip better known than one standard deviation, with orientations better still."""
    truth = hidden(so101)
    C = np.diag([3e-4, 3e-4, 3e-3, 1e-3, 1e-3, 1e-3]) ** 2
    elsewhere = poses_of(np.random.default_rng(9).uniform(-1, 1, (100, 5)))
    there = solve_equilibrium(truth, elsewhere).tcp
    errors = {"one sd": [], "covariance": [], "pose": []}
    for seed in range(4):
        data = measured(truth, 50, seed, C)
        alone, pose = positions_only(data), replace(data, observations=data.observations[:2])
        for name, way in {"one sd": alike(alone), "covariance": alone, "pose": pose}.items():
            found = fitted(hidden(so101), way)
            errors[name].append(
                float(((solve_equilibrium(found.model, elsewhere).tcp - there) ** 2).sum(axis=1).mean())
            )
    rms = {name: np.sqrt(np.mean(squares)) for name, squares in errors.items()}
    assert rms["covariance"] < 0.6 * rms["one sd"]
    assert rms["pose"] < rms["covariance"]


@pytest.mark.slow
def test_droop_and_flex_are_told_apart_by_joint_feedback(so101: Arm) -> None:
    truth = hidden(so101, servo_droop__joint2__k_rad_per_Nm=0.06)
    start = model_of(so101, [effect for name in ("offsets", "compliance") for effect in effects_at(so101, name)])
    data = measured(truth, 60, 5)
    seen = diagnose(fitted(start, data).model, data)
    assert [one.name for one in seen.supported][:1] == ["servo_droop@joint2"]
    blind = positions_only(data)
    unseen = diagnose(fitted(start, blind).model, blind)
    reasons = {effect.name: reason for effect, reason in unseen.not_testable}
    assert reasons["servo_droop@joint2"].kind is ReasonKind.POSES
    assert "indistinguishable" in reasons["servo_droop@joint2"].said
    assert not unseen.supported
    both = model_of(so101, (*start.effects, *effects_at(so101, "servo_droop@joint2")))
    found = fitted(both, data)
    error = dict(zip(found.model.free, found.standard_error, strict=True))
    for key in ("servo_droop.joint2.k_rad_per_Nm", "compliance.joint2.k_rad_per_Nm"):
        assert abs(found.model.value(key) - truth.value(key)) < 4 * error[key]
        assert error[key] < 0.004


def test_weights_of_no_column_are_none(so101: Arm) -> None:
    whitening = measured(model_of(so101, ()), 5, 1).whitening
    rows = 5 * whitening.rows(so101.dof)
    assert RowWeights(whitening, np.ones(5))(np.empty((rows, 0))).shape == (rows, 0)


COUNT = 12


def tilted_poses(arm: Arm, seed: int = 0) -> Poses:
    """Poses of an arm on a vehicle that stood on other slopes each time."""
    rng = np.random.default_rng(seed)
    down = np.array([0.0, 0.0, -1.0]) + rng.normal(0.0, 0.1, (COUNT, 3))
    q, number = rng.uniform(-1.2, 1.2, (COUNT, arm.dof)), np.arange(1, COUNT + 1)
    return Poses(q, np.zeros(COUNT), number=number, gravity=down / np.linalg.norm(down, axis=1, keepdims=True))


def tips(arm: Arm, poses: Poses) -> Array:
    model = model_of(arm, effects_at(arm, "compliance"))
    return solve_equilibrium(model.with_values(np.full(len(model.keys), 0.05)), poses).tcp


def written(folder: Path, arm: Arm, poses: Poses, *gravity: tuple[str, Array, int]) -> Path:
    stated = quantity_columns([("pose", poses.number, 0), ("angles", poses.q, 9), ("position", tips(arm, poses), 9)])
    path = folder / "data.csv"
    path.write_text(csv_text([*stated, *gravity]))
    return path


def columns(names: str, values: Array) -> list[tuple[str, Array, int]]:
    return [(name, column, 12) for name, column in zip(names.split(), values.T, strict=True)]


@pytest.mark.parametrize("strength", [1.0, 9.72])
def test_a_direction_or_an_acceleration(lab: Arm, tmp_path: Path, strength: float) -> None:
    poses = tilted_poses(lab)
    path = written(tmp_path, lab, poses, *columns("gx gy gz", strength * poses.gravity))
    data = load_measurements(path, lab)
    np.testing.assert_allclose(data.poses.gravity, poses.gravity, atol=1e-9)
    np.testing.assert_allclose(tips(lab, data.poses), data.tcp, atol=1e-8)
    assert "gravity" in repr(data)
    path.write_text(measurements_csv(data))
    np.testing.assert_allclose(load_measurements(path, lab).poses.gravity, poses.gravity, atol=1e-8)


def test_roll_and_pitch(lab: Arm, tmp_path: Path) -> None:
    """Gravity leans to the side of the base that has sunk: with pitch about y, x points down."""
    roll_pitch = np.tile([[10.0, -20.0], [0.0, 5.0], [0.0, 0.0]], (COUNT // 3, 1))
    path = written(tmp_path, lab, tilted_poses(lab), *columns("roll_deg pitch_deg", roll_pitch))
    found = load_measurements(path, lab).poses.gravity
    r, p = np.radians(roll_pitch).T
    expected = np.stack([np.sin(p), -np.cos(p) * np.sin(r), -np.cos(p) * np.cos(r)], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_array_equal(found[2], [0.0, 0.0, -1.0])


@given(st.integers(0, 100))
def test_it_turns_with_the_frame_of_the_positions(lab: Arm, seed: int) -> None:
    R = Rotation.random(random_state=seed).as_matrix()
    poses = tilted_poses(lab, seed)
    data = leaning_measurements(lab, poses).turned(R, np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(data.poses.gravity, poses.gravity @ R.T)


def leaning_measurements(arm: Arm, poses: Poses) -> Measurements:
    return Measurements.of_tcp(poses, tips(arm, poses))


@pytest.mark.parametrize("command", [False, True])
def test_axes_of_the_file(lab: Arm, tmp_path: Path, command: bool) -> None:
    """Positions and gravity of a file whose y points where the arm's x does; commands alone are read alike."""
    poses, to_file = tilted_poses(lab), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    path = written(tmp_path, lab, poses, *columns("gx gy gz", poses.gravity @ to_file.T))
    how = Reading(axes="y,-x,z")
    read = load_poses(path, lab, how) if command else load_measurements(path, lab, how).poses
    np.testing.assert_allclose(read.gravity, poses.gravity, atol=1e-12)


@pytest.mark.parametrize(
    ("names", "values", "said"),
    [
        ("gx gy gz", [0.0, 0.0, -5.0], "line 2.*length.*should be a direction|line 2.*length"),
        ("gx gy gz", [0.0, 0.1, 9.81], "line 2.*the other way.*accelerometer at rest reads up"),
        ("gx gy", [0.0, 0.0], "no column gz.*gx, gy, gz go together"),
        ("roll_deg pitch_deg", [0.0, 95.0], "line 2, column pitch_deg.*beyond 90 deg"),
        ("gx gy gz roll_deg pitch_deg", [0.0, 0.0, -1.0, 0.0, 0.0], "gravity is stated twice"),
    ],
)
def test_what_cannot_be_is_one_line(lab: Arm, tmp_path: Path, names: str, values: list[float], said: str) -> None:
    path = written(tmp_path, lab, tilted_poses(lab), *columns(names, np.tile(values, (COUNT, 1))))
    with pytest.raises(FileError, match=said):
        load_measurements(path, lab)


def test_an_arm_file_without_gravity(lab: Arm, tmp_path: Path) -> None:
    path = written(tmp_path, lab, tilted_poses(lab), *columns("gx gy gz", np.tile([0.0, 0.0, -1.0], (COUNT, 1))))
    with pytest.raises(FileError, match=r"gravity is stated.*has none"):
        load_measurements(path, replace(lab, gravity=(0.0, 0.0, 0.0)))


def test_predict_bends_the_arm_by_the_stated_direction(tmp_path: Path) -> None:
    model, out = load_model(TABLE_B2), tmp_path / "out.csv"
    poses = tilted_poses(model.arm)
    path = written(tmp_path, model.arm, poses, *columns("gx gy gz", np.asarray(poses.gravity)))
    stdout_of("predict", TABLE_B2, path, "-o", out)
    read = np.genfromtxt(out, delimiter=",", names=True)
    expected = solve_equilibrium(model, poses).tcp
    np.testing.assert_allclose(
        np.stack([read[name] for name in ("x_mm", "y_mm", "z_mm")], axis=1), 1e3 * expected, atol=1e-4
    )
    level = solve_equilibrium(model, replace(poses, gravity=None)).tcp
    assert np.abs(expected - level).max() > 1e-3
