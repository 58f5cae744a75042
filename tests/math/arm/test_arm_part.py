"""The part of an arm that goes wherever it is mounted: what differs in it is named, with both values."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lrm_math.arm.arm import Arm, Placement
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.arm_part import arm_part_difference
from lrm_math.arm.servo_table import ServoTable

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
