"""A tracker's frame distorts about the centre of what was measured; the model file alone says where that is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.study.model_history import as_written
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import measured_range, solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile, parameter_tables, range_table, to_model
from tests.support.sweep import examples

FRAMES = ("depth_scale@frame", "measurement_frame@frame", "frame_curve@frame")
SCALE_X = "measurement_frame.frame.scale_x_mm_per_m"


def distorted(arm: Arm, name: str, seed: int) -> Model:
    """The nominal arm seen by a tracker that distorts space at random, within the range of random poses."""
    effects = effects_at(arm, name)
    values = np.random.default_rng(seed).normal(size=len(effects[0].keys)) * [p.typical for p in effects[0].parameters]
    plain = model_of(arm, effects)
    poses = poses_of(np.random.default_rng(seed + 1).uniform(-1.0, 0.5, (50, arm.dof)))
    return replace(plain.with_values(values), within=measured_range(solve_equilibrium(plain, poses)), free=plain.keys)


@examples(5, 10)
@given(seed=st.integers(0, 1000))
def test_scale_and_shear_leave_the_centre_of_the_measured_points_in_place(lab: Arm, seed: int) -> None:
    model = distorted(lab, "measurement_frame@frame", seed)
    poses = poses_of(np.random.default_rng(seed + 1).uniform(-1.0, 0.5, (50, lab.dof)))
    moved = solve_equilibrium(model, poses).tcp - solve_equilibrium(model_of(lab, ()), poses).tcp
    assert np.abs(moved).max() > 1e-5
    np.testing.assert_allclose(moved.mean(axis=0), 0.0, atol=1e-12)


@examples(5, 10)
@given(scale=st.floats(-0.02, 0.02), azimuth=st.floats(-3.0, 3.0), elevation=st.floats(-1.5, 1.5))
def test_depth_is_scaled_along_its_direction_alone(lab: Arm, scale: float, azimuth: float, elevation: float) -> None:
    plain = distorted(lab, "depth_scale@frame", 1)
    model = plain.with_values(np.array([scale, azimuth, elevation]))
    poses = poses_of(np.random.default_rng(2).uniform(-1.0, 0.5, (50, lab.dof)))
    true = solve_equilibrium(model_of(lab, ()), poses).tcp
    moved = solve_equilibrium(model, poses).tcp - true
    along = Rotation.from_euler("yz", [-elevation, azimuth]).apply([1.0, 0.0, 0.0])
    apart = true - true.mean(axis=0)
    np.testing.assert_allclose(moved @ along, scale * apart @ along, atol=1e-10)
    np.testing.assert_allclose(np.cross(moved, along), 0.0, atol=1e-10)


@pytest.mark.parametrize("name", FRAMES)
def test_a_model_file_alone_predicts(lab: Arm, name: str) -> None:
    model = distorted(lab, name, 3)
    file = ModelFile(
        schema="lrm/model/1",
        arm="lrm-lab",
        effects=[name],
        parameters=parameter_tables(model),
        range=range_table(model),
    )
    read = to_model(Path("m.toml"), file, lab)
    poses = poses_of(np.random.default_rng(9).uniform(-1.2, 1.2, (20, lab.dof)))
    apart = solve_equilibrium(read, poses).tcp - solve_equilibrium(model, poses).tcp
    np.testing.assert_allclose(apart, 0.0, atol=1e-12)


def test_older_files_are_about_the_base_or_are_refused(lab: Arm) -> None:
    """Those without a centre predict as they did; those whose frame turns say what to do."""
    file = ModelFile(schema="lrm/model/1", arm="lrm-lab", effects=["measurement_frame"], parameters={SCALE_X: 2.0})
    poses = poses_of([0.3, -0.2, 0.5, 0.1, 0.4, 0.0])
    seen = solve_equilibrium(to_model(Path("m.toml"), file, lab), poses).tcp
    true = solve_equilibrium(model_of(lab, ()), poses).tcp
    np.testing.assert_allclose(seen, true * [1.002, 1.0, 1.0], atol=1e-12)
    turned = file.model_copy(update={"parameters": {"measurement_frame.frame.turn_x_rad": 0.01}})
    with pytest.raises(FileError, match=r"turn_x_rad: .* fit again"):
        to_model(Path("m.toml"), turned, lab)


def test_a_refit_to_other_poses_has_their_centre(lab: Arm) -> None:
    """The first residual and derivatives of a fit are already about the new centre."""
    model = distorted(lab, "measurement_frame@frame", 5)
    q = np.random.default_rng(6).uniform(-0.2, 1.2, (60, lab.dof))
    centred = replace(model, within=measured_range(solve_equilibrium(model, poses_of(q))))
    number = np.arange(60)
    data = Measurements.of_tcp(
        poses_of(q), solve_equilibrium(centred, poses_of(q)).tcp, pose=number, source=Source(arm=lab)
    )
    found = fit(model, data)
    assert np.abs(found.residual).max() < 1e-9
    again = as_written(found.model, "lrm-lab")
    np.testing.assert_allclose(data.residual(solve_equilibrium(again, data.poses)), 0.0, atol=1e-9)
