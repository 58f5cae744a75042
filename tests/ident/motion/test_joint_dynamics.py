"""A robot file with identified dynamics moves in MuJoCo as the model that it came from says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_ident.data.robot_files.urdf_export import ExportedFile
from lrm_ident.measuring.motion.joint_dynamics import joint_dynamics, with_dynamics
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import FileError
from lrm_math.model.model import model_of
from lrm_math.motion.motion_model import MotionModel, effect_of

ARM = load_arm("so101")
FREQUENCY, DAMPING, SAG, RUBS = 4.0, 0.4, 0.04, 0.02


def motion(friction: bool = False) -> MotionModel:
    """An SO-101 whose wrist yields to gravity, and rubs."""
    model = MotionModel.nominal(ARM)
    stated = {"frequency_Hz": FREQUENCY, "damping_ratio": DAMPING, "b_rad": 0.0}
    model = replace(model, values={key: stated[key.split(".")[-1]] for key in model.values})
    more = [effect_of(ARM, "gravity_sag@joint5"), *([effect_of(ARM, "coulomb_friction@joint5")] if friction else [])]
    values = {key: SAG if "sag" in key else RUBS for effect in more for key in effect.keys}
    return model.with_joint((*model.of_joint(4), *more), {**model.values, **values}, {})


def test_a_joint_in_mujoco_follows_as_the_second_order_servo() -> None:
    mujoco = pytest.importorskip("mujoco", reason="extra mujoco")
    poses = model_of(ARM, ())
    file = with_dynamics(mjcf(poses), Path("arm.xml"), motion(), poses)
    model = mujoco.MjModel.from_xml_string(file.text)
    model.opt.timestep, model.opt.gravity[:] = 2e-4, 0.0
    data, number = mujoco.MjData(model), mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, "wrist_roll")
    data.ctrl[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, "wrist_roll")] = 0.5
    seen = []
    for _ in range(2000):
        mujoco.mj_step(model, data)
        seen.append(float(data.qpos[model.jnt_qposadr[number]]))
    t, omega = 2e-4 * np.arange(1, 2001), 2.0 * np.pi * FREQUENCY
    swings = omega * np.sqrt(1.0 - DAMPING**2)
    expected = 1.0 - np.exp(-DAMPING * omega * t) * (np.cos(swings * t) + DAMPING * omega / swings * np.sin(swings * t))
    assert np.abs(np.array(seen) - 0.5 * expected).max() < 0.01
    assert any("stiffness is unknown" in name for name in file.left_out)


def test_torques_follow_from_the_stiffness_that_gravity_shows() -> None:
    found, left_out = joint_dynamics(motion(friction=True), model_of(ARM, ()))
    wrist = found["wrist_roll"]
    assert list(found) == ["wrist_roll"]
    assert len(left_out) == 4
    assert wrist.stiffness == pytest.approx(1.0 / SAG)
    assert wrist.friction == pytest.approx(RUBS / SAG)
    assert wrist.damping == pytest.approx(2.0 * DAMPING / (2.0 * np.pi * FREQUENCY) / SAG)
    assert wrist.armature == pytest.approx(1.0 / SAG / (2.0 * np.pi * FREQUENCY) ** 2, rel=1e-3)


def test_a_urdf_has_dynamics_and_other_files_are_refused() -> None:
    text = '<robot name="a"><joint name="wrist_roll" type="revolute"><dynamics damping="9"/></joint></robot>'
    poses = model_of(ARM, ())
    file = with_dynamics(ExportedFile(text, "URDF", ()), Path("arm.urdf"), motion(), poses)
    dynamics = ElementTree.fromstring(file.text).find("joint/dynamics")
    assert dynamics is not None
    assert float(dynamics.get("damping", "nan")) == pytest.approx(
        2.0 * DAMPING / (2.0 * np.pi * FREQUENCY) / SAG, rel=1e-5
    )
    with pytest.raises(FileError, match="holds no dynamics"):
        with_dynamics(ExportedFile("{}", "x", ()), Path("arm.json"), motion(), poses)
    with pytest.raises(FileError, match="is a model of so101"):
        with_dynamics(ExportedFile(text, "URDF", ()), Path("arm.urdf"), motion(), model_of(load_arm("so100"), ()))
