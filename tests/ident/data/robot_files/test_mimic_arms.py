"""Imported arms of which some joints follow others move as in MuJoCo, where the couplings are met exactly."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from lrm_ident.data.robot_files.arm_text import arm_text
from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_ident.data.robot_files.mjcf_patch import patched_mjcf
from lrm_ident.data.robot_files.mjcf_robot import read_mjcf, read_robot
from lrm_ident.data.robot_files.urdf import parse_urdf
from lrm_ident.data.robot_files.urdf_arm import import_arm, largest_difference
from lrm_ident.data.robot_files.urdf_export import bare_urdf, corrected_urdf
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import read_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.commands import stderr_of
from tests.support.mimic_robots import chain_mjcf, palletiser
from tests.support.sweep import seeds


class MujocoMechanism:
    """A robot in MuJoCo, its equalities of joints met exactly."""

    def __init__(self, model: Any, motors: list[str]) -> None:
        import mujoco

        self.mujoco, self.model, self.data = mujoco, model, mujoco.MjData(model)
        self.motors = [int(model.joint(name).qposadr[0]) for name in motors]

    def angles(self, q: Array) -> Array:
        """Angles of all joints, from those of the ones with a motor (rad)."""
        model, out = self.model, self.model.qpos0.copy()
        out[self.motors] = q
        for _ in range(model.neq):
            for first, second, data in zip(model.eq_obj1id, model.eq_obj2id, model.eq_data, strict=True):
                out[first] = model.qpos0[first] + data[0] + data[1] * (out[second] - model.qpos0[second])
        return np.asarray(out)

    def moved(self, q: Array) -> tuple[Array, Array]:
        """Position of the tip (m), and gravity's torque on the motors (N·m) by virtual work."""
        self.data.qpos[:] = self.angles(q)
        self.mujoco.mj_forward(self.model, self.data)
        at_zero = self.angles(np.zeros(len(q)))
        C = np.array([self.angles(one) - at_zero for one in np.eye(len(q))])
        tip = self.data.site("tip").xpos if self.model.nsite else self.data.body("tip").xpos
        return tip.copy(), -C @ self.data.qfrc_bias


def at_rest(arm: Arm, q: Array) -> Equilibrium:
    """The rigid arm at one pose."""
    return solve_equilibrium(model_of(arm, ()), poses_of(q))


@pytest.mark.parametrize("seed", seeds(3, 8))
def test_an_mjcf_with_joint_equalities_moves_as_in_mujoco(seed: int, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    path = tmp_path / "arm.xml"
    path.write_text(chain_mjcf(seed))
    found = import_arm(read_robot(path), tip="tip")
    peer = MujocoMechanism(mujoco.MjModel.from_xml_path(str(path)), [joint.name for joint in found.arm.joints])
    assert len(found.arm.mimics) == 1 + seed % 3
    for q in np.random.default_rng(seed).uniform(-1.0, 1.0, (5, found.arm.dof)):
        ours, (tip, torque) = at_rest(found.arm, q), peer.moved(q)
        np.testing.assert_allclose(ours.tcp[0], tip, atol=1e-9)
        np.testing.assert_allclose(ours.joint_torque[0], torque, atol=1e-9)


def test_a_palletiser_moves_as_in_mujoco() -> None:
    """The gripper stays level, and its forearm's direction is that of its own motor alone."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    arm = import_arm(parse_urdf(Path("palletiser.urdf"), palletiser())).arm
    whole = palletiser().replace(
        '<link name="base"/>', '<mujoco><compiler fusestatic="false"/></mujoco><link name="base"/>'
    )
    spec = mujoco.MjSpec.from_string(whole)
    for leader, follower in (("rear", "rod"), ("front", "level")):
        spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=follower, name2=leader, data=[0.0, -1.0] + [0.0] * 10)
    assert arm.link_places == ("joint1", "joint2", "mimic1", "joint3", "mimic2", "joint4")
    peer = MujocoMechanism(spec.compile(), [joint.name for joint in arm.joints])
    for q in np.random.default_rng(0).uniform(-0.3, 1.2, (5, 4)):
        ours, (tip, torque) = at_rest(arm, q), peer.moved(q)
        np.testing.assert_allclose(ours.tcp[0], tip, atol=1e-9)
        np.testing.assert_allclose(ours.joint_torque[0], torque, atol=1e-9)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (
            'joint = "joint2"',
            'joint = "joint9"',
            "joint 3: follow: joint = 'joint9'; should be a joint with a motor of its",
        ),
        ('joint = "joint2"', 'joint = "mimic2"', "own: joint1, joint2, joint3, joint4"),
        ("ratio = -1.0", "ratios = -1.0", "unknown key ratios"),
        ('frame = "mimic2"', 'frame = "mimic3"', "unknown frame 'mimic3'"),
    ],
)
def test_a_fault_of_a_following_joint_is_named(before: str, after: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    text = arm_text(import_arm(parse_urdf(Path("palletiser.urdf"), palletiser())).arm, "palletiser.urdf")
    path.write_text(text)
    assert read_arm(path).link_places == ("joint1", "joint2", "mimic1", "joint3", "mimic2", "joint4")
    assert before in text
    path.write_text(text.replace(before, after, 1))
    assert said in stderr_of("arm", "show", path)


def test_a_joint_is_followed_by_its_own_name_too(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    text = arm_text(import_arm(parse_urdf(Path("palletiser.urdf"), palletiser())).arm, "palletiser.urdf")
    path.write_text(text.replace('joint = "joint3"', 'joint = "front"'))
    assert [mimic.leader for mimic in read_arm(path).mimics] == [1, 2]


def errors_of(arm: Arm, seed: int) -> Model:
    """A model of an arm whose every dimension is a little off."""
    drawn = model_of(arm, effects_at(arm, "offsets"))
    return drawn.with_values(np.random.default_rng(seed).normal(0.0, 0.003, len(drawn.keys)))


@pytest.mark.long
@pytest.mark.parametrize("kind", ["urdf", "xml"])
@pytest.mark.parametrize("seed", range(3))
def test_what_is_exported_is_imported_again_the_same(seed: int, kind: str, tmp_path: Path) -> None:
    """Kinematics, torques and couplings, of a robot whose joints also follow at an offset."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    path = tmp_path / "arm.xml"
    path.write_text(chain_mjcf(seed))
    arm = import_arm(read_robot(path), tip="tip").arm
    text = (
        ElementTree.tostring(bare_urdf(arm).tree, encoding="unicode")
        if kind == "urdf"
        else mjcf(model_of(arm, ())).text
    )
    path = tmp_path / f"again.{kind}"
    path.write_text(text)
    again = import_arm(read_robot(path), tip="tcp").arm
    assert again.link_places == arm.link_places
    for one, other in zip(arm.mimics, again.mimics, strict=True):
        assert (other.leader, other.after) == (one.leader, one.after)
        assert (other.ratio, other.offset) == pytest.approx((one.ratio, one.offset), abs=1e-12)
    q = np.random.default_rng(seed).uniform(-1.0, 1.0, (5, arm.dof))
    np.testing.assert_allclose(at_rest(again, q).tcp, at_rest(arm, q).tcp, atol=1e-9)
    milligrams = 1e-9 if kind == "urdf" else 2e-5  # N·m, of the bodies that MuJoCo wants to weigh something
    np.testing.assert_allclose(at_rest(again, q).joint_torque, at_rest(arm, q).joint_torque, atol=milligrams)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["urdf", "xml"])
@pytest.mark.parametrize("seed", range(2))
def test_a_corrected_file_moves_as_the_model(seed: int, kind: str, tmp_path: Path) -> None:
    """Errors of joints that follow, and of those that lead them, are in the frames; its couplings stay as they were."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    path = tmp_path / f"arm.{kind}"
    path.write_text(
        palletiser().replace("multiplier", 'offset="0.07" multiplier') if kind == "urdf" else chain_mjcf(seed)
    )
    robot = read_robot(path)
    model = errors_of(import_arm(robot).arm, seed)
    corrected = tmp_path / f"corrected.{kind}"
    if kind == "urdf":
        corrected.write_text(corrected_urdf(model, robot))
    else:
        corrected.write_text(patched_mjcf(model, read_mjcf(path), corrected).text)
    written = read_robot(corrected)
    tip = next(tip for tip in written.tips if not tip.endswith("_joint"))
    precision = 1e-9 if kind == "urdf" else 2e-5  # MuJoCo writes six digits
    assert largest_difference(model, written.chain(written.root, tip)) < precision
