"""A robot file with identified dynamics moves in MuJoCo as the model that it came from says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import tomli_w

from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_ident.data.robot_files.urdf import parse_urdf
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_ident.data.robot_files.urdf_export import ExportedFile
from lrm_ident.measuring.motion.joint_dynamics import joint_dynamics, with_dynamics
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import FileError
from lrm_math.model.model import model_of
from lrm_math.motion.motion_model import MotionModel, effect_of
from tests.support.commands import stderr_of, stdout_of
from tests.support.mimic_robots import palletiser
from tests.support.motion_models import motion_text

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


def test_play_in_motion_is_a_joint_with_a_range_whatever_is_known_of_stiffness() -> None:
    mujoco = pytest.importorskip("mujoco", reason="extra mujoco")
    poses, model = model_of(ARM, ()), motion()
    play = effect_of(ARM, "motion_play@joint3")
    values = {**model.values, play.keys[0]: 0.05}
    model = model.with_joint((*model.of_joint(2), play), values, {})
    file = with_dynamics(mjcf(poses), Path("arm.xml"), model, poses)
    built = mujoco.MjModel.from_xml_string(file.text)
    number = mujoco.mj_name2id(built, mujoco.mjtObj.mjOBJ_JOINT, "elbow_flex_play")
    np.testing.assert_allclose(built.jnt_range[number], [-0.025, 0.025])
    assert built.jnt_bodyid[number] == built.jnt_bodyid[number - 1]
    assert "motion_play@joint3" not in file.left_out
    by_degrees = mjcf(poses).text.replace('angle="radian" ', "")
    own = with_dynamics(ExportedFile(by_degrees, "MJCF", ()), Path("arm.xml"), model, poses).text
    assert np.degrees(0.025) == pytest.approx(mujoco_range(own), rel=1e-5)
    text = '<robot name="a"><joint name="elbow_flex" type="revolute"/></robot>'
    assert "motion_play@joint3" in with_dynamics(ExportedFile(text, "URDF", ()), Path("a.urdf"), model, poses).left_out


def test_play_of_a_joint_that_others_follow_is_left_out_and_not_written() -> None:
    arm = import_arm(parse_urdf(Path("palletiser.urdf"), palletiser())).arm
    model, play = MotionModel.nominal(arm), effect_of(arm, "motion_play@joint2")
    model = model.with_joint((*model.of_joint(1), play), {**model.values, play.keys[0]: 0.05}, {})
    poses = model_of(arm, effects_at(arm, "backlash@joint2"), {"backlash.joint2.b_rad": 0.03})
    file = with_dynamics(mjcf(poses), Path("arm.xml"), model, poses)
    reason = "(others follow its servo alone)"
    assert {f"backlash@joint2 {reason}", f"motion_play@joint2 {reason}"} <= {*file.left_out}
    assert "rear_play" not in file.text


def mujoco_range(text: str) -> float:
    """The upper end of the elbow's play as its file states it."""
    (joint,) = (one for one in ElementTree.fromstring(text).iter("joint") if one.get("name") == "elbow_flex_play")
    return float(joint.get("range", "").split()[1])


def test_isaac_lab_gets_the_same_dynamics_by_its_own_names(tmp_path: Path) -> None:
    (tmp_path / "motion.toml").write_text(motion_text(motion(friction=True)))
    out = stdout_of("arm", "export", "so101", "--motion", tmp_path / "motion.toml", "-o", tmp_path / "actuators.json")
    fields = json.loads((tmp_path / "actuators.json").read_text())
    wrist = joint_dynamics(motion(friction=True), model_of(ARM, ()))[0]["wrist_roll"]
    assert fields == {
        "joint_names_expr": ["wrist_roll"],
        "stiffness": {"wrist_roll": pytest.approx(wrist.stiffness)},
        "damping": {"wrist_roll": pytest.approx(wrist.damping)},
        "armature": {"wrist_roll": pytest.approx(wrist.armature)},
        "friction": {"wrist_roll": pytest.approx(wrist.friction)},
        "dynamic_friction": {"wrist_roll": pytest.approx(wrist.friction)},
        "viscous_friction": {"wrist_roll": 0.0},
    }
    assert "shoulder_pan" in out


def test_isaac_lab_needs_a_motion_model_and_a_known_stiffness(tmp_path: Path) -> None:
    path = tmp_path / "actuators.json"
    assert "--motion" in stderr_of("arm", "export", "so101", "-o", path)
    (tmp_path / "motion.toml").write_text(motion_text(MotionModel.nominal(ARM)))
    assert "stiffness" in stderr_of("arm", "export", "so101", "--motion", tmp_path / "motion.toml", "-o", path)
    assert not path.exists()


@pytest.mark.long
def test_variants_are_as_far_apart_as_the_fit_leaves_open(tmp_path: Path) -> None:
    key, omega = "servo_response.joint5.frequency_Hz", 2.0 * np.pi * FREQUENCY
    open_ = replace(motion(), sigma={key: 0.1})
    rng = np.random.default_rng(0)
    drawn = [open_.drawn(rng) for _ in range(400)]
    assert np.std([one.values[key] for one in drawn]) == pytest.approx(0.1, rel=0.1)
    assert {one.values["gravity_sag.joint5.k_rad_per_Nm"] for one in drawn} == {SAG}
    found = [joint_dynamics(one, model_of(ARM, ()))[0]["wrist_roll"].armature for one in drawn]
    assert np.std(found) == pytest.approx(2.0 * 0.1 / FREQUENCY / SAG / omega**2, rel=0.15)
    tables = {
        "schema": "lrm/motion/2", "arm": "so101", "effects": [effect.name for effect in open_.effects],
        "parameters": dict(open_.values), "sigma": {key: 0.1},
    }  # fmt: skip
    (tmp_path / "motion.toml").write_text(tomli_w.dumps(tables))
    stdout_of(
        "arm", "export", "so101", "--motion", tmp_path / "motion.toml", "--samples", "3", "-o", tmp_path / "arm.xml"
    )
    texts = [(tmp_path / f"arm-00{n}.xml").read_text() for n in (1, 2, 3)]
    assert len(set(texts)) == 3
