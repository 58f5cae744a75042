"""Forty robots' files beside MuJoCo reading the bare text: poses of the tip to 1e-9 m, torques to 1e-9 N·m."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.robot_files.mjcf_robot import read_robot
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.many_robots import many_robots
from validation.vendor_arms.mujoco_robot import MujocoRobot

ROBOTS = many_robots()


def test_there_are_forty() -> None:
    assert len(ROBOTS) == 40


@pytest.mark.long
@pytest.mark.parametrize("name", ROBOTS)
def test_an_imported_arm_moves_and_sags_as_in_mujoco(name: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    robot, ending = ROBOTS[name], ROBOTS[name].ending
    written, plain = tmp_path / f"written{ending}", tmp_path / ("plain.xml" if ending == ".xml" else "plain.urdf")
    written.write_bytes(robot.content)
    plain.write_text(robot.plain)
    found = import_arm(read_robot(written), base=robot.base, tip="tip")
    peer = MujocoRobot.of(plain, read_robot(plain), found)
    q = np.random.default_rng(len(name)).uniform(-1.2, 1.2, (5, found.arm.dof))
    ours = solve_equilibrium(model_of(found.arm, ()), poses_of(q))
    tips, torques = map(np.array, zip(*(peer.moved(angles) for angles in q), strict=True))
    np.testing.assert_allclose(ours.tcp, tips, atol=1e-9)
    np.testing.assert_allclose(ours.joint_torque, torques, atol=1e-9)
    assert np.abs(torques).max() > 0.01
