"""Robots with joints that follow others: a palletiser whose rods hold forearm and gripper, and chains of any such."""

from __future__ import annotations

import numpy as np

from tests.support.vendor_robots import numbers

INERTIA = '<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>'


def _link(name: str, mass: float, com: tuple[float, float, float]) -> str:
    return (
        f'<link name="{name}"><inertial><origin xyz="{numbers(com)}"/><mass value="{mass}"/>{INERTIA}</inertial></link>'
    )


def _joint(name: str, ends: str, xyz: str, axis: str, limits: tuple[float, float], more: str = "") -> str:
    parent, child = ends.split()
    limit = f'<limit lower="{limits[0]}" upper="{limits[1]}" effort="5" velocity="1"/>'
    placed = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>'
    return f'<joint name="{name}" type="revolute">{placed}{limit}{more}</joint>'


def palletiser() -> str:
    """URDF of an arm of a Dobot's make: rods hold the direction of the forearm, whatever the upper arm does, and level
    the gripper. Four joints turn by themselves, two follow."""
    return "\n".join(
        [
            '<robot name="palletiser"><link name="base"/>',
            _joint("yaw", "base turret", "0 0 0.08", "0 0 1", (-1.6, 1.6)),
            _link("turret", 0.3, (0.0, 0.01, 0.03)),
            _joint("rear", "turret upper", "0.02 0 0.058", "0 1 0", (-0.3, 1.45)),
            _link("upper", 0.16, (0.005, 0.0, 0.07)),
            _joint("rod", "upper carrier", "0 0 0.135", "0 1 0", (-1.6, 0.5), '<mimic joint="rear" multiplier="-1"/>'),
            _link("carrier", 0.02, (0.01, 0.0, 0.0)),
            _joint("front", "carrier forearm", "0 0 0", "0 1 0", (-0.6, 1.2)),
            _link("forearm", 0.14, (0.07, 0.004, 0.0)),
            _joint(
                "level", "forearm wrist", "0.147 0 0", "0 1 0", (-1.2, 0.6), '<mimic joint="front" multiplier="-1"/>'
            ),
            _link("wrist", 0.06, (0.03, 0.0, -0.01)),
            _joint("spin", "wrist gripper", "0.06 0 0", "0 0 1", (-1.5, 1.5)),
            _link("gripper", 0.05, (0.006, 0.003, -0.03)),
            '<joint name="tip_joint" type="fixed"><parent link="gripper"/><child link="tip"/>',
            '<origin xyz="0.01 0.004 -0.06"/></joint><link name="tip"/></robot>',
        ]
    )


def chain_mjcf(seed: int, count: int = 6) -> str:
    """MJCF of a chain of hinges j1 … with a site `tip`; one to three of them follow others, or followers."""
    rng = np.random.default_rng(seed)
    motors = sorted(rng.choice(count, count - 1 - seed % 3, replace=False).tolist())
    bodies, equalities = "", ""
    for joint in range(count):
        place = f'pos="{numbers(rng.uniform(-0.12, 0.12, 3))}" euler="{numbers(rng.uniform(-2, 2, 3))}"'
        mass = f'pos="{numbers(rng.normal(0, 0.05, 3))}" mass="{rng.uniform(0.05, 0.4)}" diaginertia="1e-4 1e-4 1e-4"'
        hinge = f'axis="{numbers(rng.normal(0, 1, 3))}" pos="{numbers(rng.normal(0, 0.02, 3))}" range="-6 6"'
        ref = f'ref="{rng.choice([0.0, rng.normal(0, 0.3)])}"'
        bodies += f'<body name="l{joint + 1}" {place}><inertial {mass}/><joint name="j{joint + 1}" {hinge} {ref}/>\n'
        if joint not in motors:
            leader = 1 + int(rng.choice(motors if rng.random() < 0.5 else [*motors, *range(joint)]))
            linear = f"{rng.normal(0, 0.2)} {rng.choice([-1.0, 1.0, 0.5, -1.5])} 0 0 0"
            equalities += f'<joint joint1="j{joint + 1}" joint2="j{leader}" polycoef="{linear}"/>\n'
    tip = '<site name="tip" pos="0.05 0.01 -0.03"/>' + "</body>" * count
    compiler = '<compiler angle="radian" autolimits="true"/>'
    return f'<mujoco model="m">{compiler}<worldbody>{bodies}{tip}</worldbody><equality>{equalities}</equality></mujoco>'
