"""Digest of an arm: each link, the tool and each mass counts; how it stands, turns and is called does not."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest

from lrm_math.arm.arm import Arm, Joint, Placement
from lrm_math.arm.arm_digest import arm_sha256
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.arm.collision_shapes import Shapes

ROVER = load_arm("lrm-rover")
LEAST = 1e-7  # m, rad, kg
LINK = ("theta", "d", "a", "alpha", "beta", "extra_z")


def with_joint(number: int, joint: Joint) -> Arm:
    return replace(ROVER, joints=(*ROVER.joints[:number], joint, *ROVER.joints[number + 1 :]))


@pytest.mark.parametrize("name", LINK)
def test_a_link_that_differs_makes_another_arm(name: str) -> None:
    known = arm_sha256(ROVER)
    for number, joint in enumerate(ROVER.joints):
        if name == "beta" and not (joint.leads_parallel and number < ROVER.dof - 1):
            continue
        changed = replace(joint, **{name: (getattr(joint, name) or 0.0) + LEAST})
        assert arm_sha256(with_joint(number, changed)) != known


def test_a_tool_or_a_body_that_differs_makes_another_arm() -> None:
    changed = [replace(ROVER, tool=replace(ROVER.tool, **{f.name: 0.123})) for f in fields(Placement)]
    for body in ROVER.bodies:
        others = tuple(one for one in ROVER.bodies if one is not body)
        x, y, z = body.com
        for other in (replace(body, mass=body.mass + LEAST), replace(body, com=(x, y, z + LEAST))):
            changed.append(replace(ROVER, bodies=(*others, other)))
        changed.append(replace(ROVER, bodies=others))
    digests = {arm_sha256(arm) for arm in (ROVER, *changed)}
    assert len(digests) == 1 + len(changed)


def test_names_base_gravity_limits_servos_shapes_and_order_make_none() -> None:
    joints = tuple(replace(joint, name="j", lower=-1.0, upper=1.0, servo=None) for joint in ROVER.joints)
    bodies = tuple(replace(body, name=f"b{number}") for number, body in enumerate(reversed(ROVER.bodies)))
    base = Placement(x=1.0, gamma=1.0)
    other = Arm("other", (1.0, 0.0, -9.0), base, joints, ROVER.tool, bodies, (), Shapes())
    assert arm_sha256(other) == arm_sha256(ROVER)


def test_the_last_digit_of_a_number_makes_none() -> None:
    joint = ROVER.joints[1]
    last = replace(joint, theta=joint.theta + 1e-16, d=-0.0 if joint.d == 0.0 else joint.d * (1.0 + 2e-16))
    assert arm_sha256(with_joint(1, last)) == arm_sha256(ROVER)


def test_shipped_arms_are_different_ones() -> None:
    assert len({arm_sha256(load_arm(name)) for name in shipped_arms()}) == len(shipped_arms())
