"""The part of an arm that goes wherever it is mounted, its digest, and the arms of LeRobot that are shipped."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from lrm_math.arm.arm import Arm, Joint, Placement
from lrm_math.arm.arm_digest import arm_sha256
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.arm.arm_part import arm_part_difference
from lrm_math.arm.collision_shapes import Shapes
from lrm_math.arm.servo_table import ServoTable
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

LAB, ROVER = load_arm("lrm-lab"), load_arm("lrm-rover")


def with_joint(number: int, **changes: object) -> Arm:
    joint = replace(ROVER.joints[number - 1], **changes)  # type: ignore[arg-type]
    return replace(ROVER, name="mine", joints=(*ROVER.joints[: number - 1], joint, *ROVER.joints[number:]))


def test_the_arm_of_the_rig_is_that_of_the_rover() -> None:
    assert arm_part_difference(LAB, ROVER) == ""
    assert arm_part_difference(ROVER, LAB) == ""


def test_base_tool_gravity_limits_and_what_the_tool_carries_may_differ() -> None:
    placed = Placement(0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    own = tuple(body for body in ROVER.bodies if body.frame <= ROVER.dof)
    joints = tuple(replace(joint, lower=-1.0, upper=1.0, name="j") for joint in ROVER.joints)
    other = replace(ROVER, gravity=(0.0, 9.81, 0.0), base=placed, tool=placed, bodies=own, joints=joints)
    assert arm_part_difference(ROVER, other) == ""


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"d": 0.05}, "joint 3: d is 43.069 mm in lrm-rover, 50 mm in mine"),
        ({"theta": 0.1}, "joint 3: theta is 0 deg in lrm-rover, 5.72958 deg in mine"),
        ({"extra_z": 0.02}, "joint 3: extra_z is missing in lrm-rover, 20 mm in mine"),
        (
            {"servo": ServoTable((-1.0, 1.0), (1e-3, 2e-3))},
            "joint 3: pulse at -100 deg is 630 us in lrm-rover, 627.335 us in mine",
        ),
    ],
)
def test_a_link_or_a_servo_that_differs_is_named(changes: dict[str, object], said: str) -> None:
    assert arm_part_difference(ROVER, with_joint(3, **changes)) == said


def test_a_body_that_differs_is_named() -> None:
    heavy = tuple(replace(body, mass=0.15) if body.name == "link 4" else body for body in ROVER.bodies)
    fewer = tuple(body for body in ROVER.bodies if body.name != "link 4")
    said = "body 'link 4': mass is 133 g in lrm-rover, 150 g in mine"
    assert arm_part_difference(ROVER, replace(ROVER, name="mine", bodies=heavy)) == said
    assert "body 'link 4' of lrm-rover" in arm_part_difference(ROVER, replace(ROVER, name="mine", bodies=fewer))
    assert arm_part_difference(load_arm("so101"), ROVER) == "so101 has 5 joints, lrm-rover 6"


DIGESTED = load_arm("lrm-rover")
LEAST = 1e-7  # m, rad, kg
LINK = ("theta", "d", "a", "alpha", "beta", "extra_z")


def with_changed_joint(number: int, joint: Joint) -> Arm:
    return replace(DIGESTED, joints=(*DIGESTED.joints[:number], joint, *DIGESTED.joints[number + 1 :]))


@pytest.mark.parametrize("name", LINK)
def test_a_link_that_differs_makes_another_arm(name: str) -> None:
    known = arm_sha256(DIGESTED)
    for number, joint in enumerate(DIGESTED.joints):
        if name == "beta" and not (joint.leads_parallel and number < DIGESTED.dof - 1):
            continue
        changed = replace(joint, **{name: (getattr(joint, name) or 0.0) + LEAST})
        assert arm_sha256(with_changed_joint(number, changed)) != known


def test_a_tool_or_a_body_that_differs_makes_another_arm() -> None:
    changed = [replace(DIGESTED, tool=replace(DIGESTED.tool, **{f.name: 0.123})) for f in fields(Placement)]
    for body in DIGESTED.bodies:
        others = tuple(one for one in DIGESTED.bodies if one is not body)
        x, y, z = body.com
        for other in (replace(body, mass=body.mass + LEAST), replace(body, com=(x, y, z + LEAST))):
            changed.append(replace(DIGESTED, bodies=(*others, other)))
        changed.append(replace(DIGESTED, bodies=others))
    digests = {arm_sha256(arm) for arm in (DIGESTED, *changed)}
    assert len(digests) == 1 + len(changed)


def test_names_base_gravity_limits_servos_shapes_and_order_make_none() -> None:
    joints = tuple(replace(joint, name="j", lower=-1.0, upper=1.0, servo=None) for joint in DIGESTED.joints)
    bodies = tuple(replace(body, name=f"b{number}") for number, body in enumerate(reversed(DIGESTED.bodies)))
    base = Placement(x=1.0, gamma=1.0)
    other = Arm("other", (1.0, 0.0, -9.0), base, joints, DIGESTED.tool, bodies, (), Shapes())
    assert arm_sha256(other) == arm_sha256(DIGESTED)


def test_the_last_digit_of_a_number_makes_none() -> None:
    joint = DIGESTED.joints[1]
    last = replace(joint, theta=joint.theta + 1e-16, d=-0.0 if joint.d == 0.0 else joint.d * (1.0 + 2e-16))
    assert arm_sha256(with_changed_joint(1, last)) == arm_sha256(DIGESTED)


def test_shipped_arms_are_different_ones() -> None:
    assert len({arm_sha256(load_arm(name)) for name in shipped_arms()}) == len(shipped_arms())


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
