"""Gravity's direction as columns of measurements and of commanded poses."""

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
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.model_file import load_model
from lrm_math.model.reading import Reading
from tests.conftest import TABLE_B2
from tests.support.commands import stdout_of

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
    assert poses.gravity is not None
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
    assert found is not None
    r, p = np.radians(roll_pitch).T
    expected = np.stack([np.sin(p), -np.cos(p) * np.sin(r), -np.cos(p) * np.cos(r)], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_array_equal(found[2], [0.0, 0.0, -1.0])


@given(st.integers(0, 100))
def test_it_turns_with_the_frame_of_the_positions(lab: Arm, seed: int) -> None:
    R = Rotation.random(random_state=seed).as_matrix()
    poses = tilted_poses(lab, seed)
    data = measured(lab, poses).turned(R, np.array([0.1, 0.2, 0.3]))
    assert data.poses.gravity is not None
    assert poses.gravity is not None
    np.testing.assert_allclose(data.poses.gravity, poses.gravity @ R.T)


def measured(arm: Arm, poses: Poses) -> Measurements:
    number = np.arange(1, COUNT + 1)
    return Measurements(poses, number, tips(arm, poses), None, None, number, Path("x.csv"), "")


@pytest.mark.parametrize("command", [False, True])
def test_axes_of_the_file(lab: Arm, tmp_path: Path, command: bool) -> None:
    """Positions and gravity of a file whose y points where the arm's x does; commands alone are read alike."""
    poses, to_file = tilted_poses(lab), np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert poses.gravity is not None
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
