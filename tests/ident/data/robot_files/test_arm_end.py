"""Where an imported arm ends: before whatever gripper it carries; its last motor is none of a gripper's."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.rigid_motion import from_xyz_rpy, placement, placement_motion, to_xyz_rpy, turn
from lrm_ident.data.robot_files.urdf import parse_urdf
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_math.errors import FileError
from tests.support.mimic_robots import palletiser
from tests.support.vendor_robots import joint, link, turning, vendor_parts

RNG = np.random.default_rng(0)


def branch(name: str, kind: str, parent: str, child: str, more: str = "") -> str:
    moves = "" if kind == "fixed" else '<axis xyz="0 1 0"/><limit lower="0" upper="0.8" effort="1" velocity="1"/>'
    return link(child, RNG) + joint(name, kind, (parent, child), RNG, moves + more)


FINGERS = branch("left_finger_joint", "prismatic", "hand", "left") + branch("right_j", "prismatic", "hand", "right")
DRIVEN = (
    branch("drive", "revolute", "hand", "outer")
    + branch("left_finger_joint", "revolute", "outer", "tip1", '<mimic joint="drive" multiplier="-1"/>')
    + branch("k2", "revolute", "hand", "other", '<mimic joint="drive"/>')
)
GRIPPERS = {
    "two fingers that slide": FINGERS,
    "two that nobody named": FINGERS.replace("left_finger_joint", "joint7"),
    "a finger that slides, pads fixed on it": branch("gripper", "prismatic", "hand", "slide")
    + branch("pad", "fixed", "slide", "rubber"),
    "a jaw": branch("jaw_joint", "revolute", "hand", "jaw"),
    "a linkage that one motor drives": DRIVEN,
    "a linkage, pads fixed on it": DRIVEN + branch("pad", "fixed", "tip1", "rubber"),
}


def arm_with(gripper: str) -> str:
    """Four joints that turn, a hand, and a gripper on it."""
    parts, before = ['<link name="base"/>'], "base"
    for number in range(1, 5):
        parts.append(
            link(f"l{number}", RNG) + joint(f"j{number}", "revolute", (before, f"l{number}"), RNG, turning(RNG))
        )
        before = f"l{number}"
    return f'<robot name="r">{"".join(parts)}{branch("fix", "fixed", before, "hand")}{gripper}</robot>'


@pytest.mark.parametrize("name", GRIPPERS)
def test_an_arm_ends_before_its_gripper(name: str) -> None:
    found = import_arm(parse_urdf(Path("arm.urdf"), arm_with(GRIPPERS[name])))
    assert (found.tip, found.arm.dof, found.arm.mimics) == ("hand", 4, ())
    notice = next(words for words in found.notices if "the gripper's" in words)
    farther = re.search(r"--tip (\w+)", notice)
    assert farther[1] in arm_with(GRIPPERS[name])


@pytest.mark.parametrize("name", GRIPPERS)
def test_a_frame_fixed_on_the_hand_is_its_tip(name: str) -> None:
    tool = branch("tool", "fixed", "hand", "tool0")
    assert import_arm(parse_urdf(Path("arm.urdf"), arm_with(GRIPPERS[name] + tool))).tip == "tool0"


@pytest.mark.parametrize(
    ("leader", "said"), [("j4", "follows itself"), ("nobody", "follows joint nobody, which is none")]
)
def test_a_joint_that_follows_itself_or_nobody_is_no_gripper(leader: str, said: str) -> None:
    whole = arm_with("")
    last = whole.index('name="j4"')
    broken = f'{whole[:last]}{whole[last:].replace("</joint>", f"""<mimic joint="{leader}"/></joint>""", 1)}'
    with pytest.raises(FileError, match=said):
        import_arm(parse_urdf(Path("arm.urdf"), broken))


def test_the_last_joint_of_an_arm_is_not_taken_for_a_gripper() -> None:
    """Joints that follow one of the arm, rods beside it, and a slide that nobody calls a finger."""
    assert import_arm(parse_urdf(Path("arm.urdf"), palletiser())).arm.dof == 4
    spindle = arm_with(branch("spindle", "prismatic", "hand", "quill"))
    with pytest.raises(FileError, match="joint spindle: is prismatic; an arm has revolute joints"):
        import_arm(parse_urdf(Path("arm.urdf"), spindle))


def test_a_link_beside_the_robot_is_not_read() -> None:
    text = f'<robot name="v"><link name="room"/>{vendor_parts(3)}</robot>'
    found = import_arm(parse_urdf(Path("arm.urdf"), text))
    assert "link 'room' hangs on no joint and carries none: it is not read" in found.notices


@given(st.floats(-3.1, 3.1), st.floats(-17, 0), st.floats(-3.1, 3.1), st.sampled_from([-1.0, 1.0]))
def test_turns_near_the_pole_are_written_exactly(first: float, power: float, last: float, side: float) -> None:
    """However near a quarter turn the middle angle is (rad; 1e-11 of a rotation's elements)."""
    middle = side * (np.pi / 2.0 - 10.0**power)
    T = from_xyz_rpy((0.0, 0.0, 0.0), (first, middle, last))
    np.testing.assert_allclose(from_xyz_rpy(*to_xyz_rpy(T)), T, atol=1e-11)
    R = (turn((1, 0, 0), first) @ turn((0, 1, 0), middle) @ turn((0, 0, 1), last))[:3, :3]
    np.testing.assert_allclose(placement_motion(placement(np.zeros(3), R))[:3, :3], R, atol=1e-11)
