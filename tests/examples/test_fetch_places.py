"""Places of the fetch example: stones in the author's ground area, a pose above the basket with room on all sides."""

from __future__ import annotations

import numpy as np
import pytest

from examples.fetch.places import ARM, HOME, areas, basket_pose, pointing_down, quaternion, stones
from lrm_math.arm.arm_file import load_arm
from lrm_math.collision.scene import Scene
from lrmd.ik.service import goal_pose


def test_stones_are_the_same_by_their_seed_and_lie_in_the_authors_area() -> None:
    found, again = stones(3, 5), stones(3, 5)
    ground = areas()["ground"]
    for stone, same in zip(found, again, strict=True):
        assert np.array_equal(stone.place, same.place)
        assert ground.low[0] <= stone.place[0] <= ground.high[0]
        assert ground.low[1] <= stone.place[1] <= ground.high[1]
        assert 0.005 <= stone.mass <= 0.06
        assert all(contact.second == "ground" for contact in stone.contacts())


def test_the_pose_above_the_basket_and_the_one_to_stow_keep_the_margin() -> None:
    scene, (middle, direction, q) = Scene.of(load_arm(ARM)), basket_pose()
    assert scene.frames(q[None])[0, -1, :3, 3] == pytest.approx(middle, abs=1e-9)
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    for pose in (q, np.array(HOME)):
        assert scene.closest(pose).distance > scene.margin + 0.01


@pytest.mark.parametrize("yaw", [-3.0, 0.0, 0.4, np.pi])
def test_a_quaternion_is_that_of_its_rotation(yaw: float) -> None:
    R = pointing_down(yaw, 0.2)
    x, y, z, w = quaternion(R)
    assert np.array(goal_pose((0.0, 0.0, 0.0), (x, y, z, w)).rotation) == pytest.approx(R, abs=1e-12)
    assert R[2, 2] < -0.9
