"""Arms of LeRobot that are shipped: zeros, directions and sizes of one family, from three independent descriptions."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

NAMES = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"]


def tips(arm: Arm, q: Array) -> Array:
    """(N, 3), TCP (m) less that of the arm at zero, x ahead of it there, z up."""
    tcp = solve_equilibrium(model_of(arm, ()), poses_of(np.vstack([np.zeros(arm.dof), q]))).tcp
    tcp -= [arm.base.x, arm.base.y, 0.0]
    ahead = np.arctan2(tcp[0, 1], tcp[0, 0])
    c, s = np.cos(ahead), np.sin(ahead)
    turned = tcp @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turned - turned[0])


@pytest.mark.parametrize("name", ["so100", "lekiwi", "koch", "so101"])
def test_joints_bear_lerobots_names_and_hang_together(name: str) -> None:
    arm = load_arm(name)
    assert [joint.name for joint in arm.joints] == NAMES
    assert 0.3 < sum(body.mass for body in arm.bodies) < 1.0 or name == "koch"
    assert arm.accepted == ()


@pytest.mark.parametrize("name", ["so100", "lekiwi"])
def test_one_pose_of_lerobot_is_one_place_of_the_tip(name: str) -> None:
    """SO-100 and LeKiwi have the SO-101's links: to 12 mm, anywhere. Another zero or direction would be decimetres."""
    q = np.radians(np.random.default_rng(1).uniform(-60.0, 60.0, (200, 5)))
    apart = np.linalg.norm(tips(load_arm(name), q) - tips(load_arm("so101"), q), axis=1)
    assert apart.max() < 0.012
    turned = q * [1.0, -1.0, 1.0, 1.0, 1.0]
    assert np.linalg.norm(tips(load_arm(name), turned) - tips(load_arm("so101"), q), axis=1).mean() > 0.15
