"""Imported arms of which some joints follow others move as in MuJoCo, where the couplings are met exactly."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lrm_ident.data.robot_files.mjcf_robot import read_robot
from lrm_ident.data.robot_files.urdf import parse_urdf
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.mimic_robots import chain_mjcf, palletiser


class Peer:
    """A robot in MuJoCo, its equalities of joints met exactly."""

    def __init__(self, model: Any, motors: list[str]) -> None:
        import mujoco

        self.mujoco, self.model, self.data = mujoco, model, mujoco.MjData(model)
        self.motors = [int(model.joint(name).qposadr[0]) for name in motors]

    def angles(self, q: Array) -> Array:
        """Of all joints, from those of the ones with a motor (rad)."""
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


@pytest.mark.parametrize("seed", range(8))
def test_an_mjcf_with_joint_equalities_moves_as_in_mujoco(seed: int, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    path = tmp_path / "arm.xml"
    path.write_text(chain_mjcf(seed))
    found = import_arm(read_robot(path), tip="tip")
    peer = Peer(mujoco.MjModel.from_xml_path(str(path)), [joint.name for joint in found.arm.joints])
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
    peer = Peer(spec.compile(), [joint.name for joint in arm.joints])
    for q in np.random.default_rng(0).uniform(-0.3, 1.2, (5, 4)):
        ours, (tip, torque) = at_rest(arm, q), peer.moved(q)
        np.testing.assert_allclose(ours.tcp[0], tip, atol=1e-9)
        np.testing.assert_allclose(ours.joint_torque[0], torque, atol=1e-9)
