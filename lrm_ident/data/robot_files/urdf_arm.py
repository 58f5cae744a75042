"""The arm between two links of a URDF: axes to Denavit–Hartenberg links, masses and centres of mass with them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.data.rigid_motion import inverse, placement, placement_motion, turn
from lrm_ident.data.robot_files.denavit_hartenberg import DhLink, dh_links
from lrm_ident.data.robot_files.urdf import Urdf, UrdfJoint, UrdfMass, tip_pose
from lrm_math.arm.arm import Arm, Body, Joint
from lrm_math.arm.plausible_arm import implausible
from lrm_math.arrays import Array, Vector3
from lrm_math.errors import FileError, raise_faults
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.forward import frames
from lrm_math.model.model import Model, model_of

GRAVITY: Vector3 = (0.0, 0.0, -9.81)
MOST_JOINTS = 10
CHECKED = 200
"""Random poses at which the imported arm is compared with the URDF's own kinematics."""
AGREES = 1e-9
"""m and rad: a larger difference is a fault of the import, and refused."""


@dataclass(frozen=True, eq=False)
class ImportedArm:
    """An arm of a URDF.

    Attributes:
        base, tip: the links between which it stands.
        difference: largest difference of the tip's pose from the URDF's own kinematics (m, or rad) at random poses.
        notices: what a person should know.
    """

    arm: Arm
    base: str
    tip: str
    difference: float
    notices: tuple[str, ...]


def choose_tip(robot: Urdf, base: str) -> str:
    """The only tip of a robot. Raises `FileError` if there are several: they are listed with their joints."""
    counts = {}
    for tip in robot.tips:
        try:
            counts[tip] = sum(joint.turns for joint in robot.chain(base, tip))
        except FileError:
            continue
    moving = {tip: count for tip, count in counts.items() if count} or counts
    if len(moving) != 1:
        listed = ", ".join(f"{tip} ({count} joints)" for tip, count in moving.items())
        raise FileError(robot.path, "", f"has {len(moving)} tips", f"name the measured one with --tip: {listed}")
    return next(iter(moving))


def import_arm(robot: Urdf, base: str | None = None, tip: str | None = None, name: str | None = None) -> ImportedArm:
    """The arm from the link `base` (None: the root) to the link `tip` (None: the only one).

    Raises `FileError`: a chain that is not one of 1 to 10 revolute joints, or one that the import does not reproduce.
    """
    base = base or robot.root
    tip = tip or choose_tip(robot, base)
    path = robot.chain(base, tip)
    _check_serial(robot, path)
    turning = [joint for joint in path if joint.turns]
    axes = list(_axis_frames(path))
    placed = replace(placement(axes[0][:3, 3], axes[0][:3, :3]), gamma=0.0)
    links, stands = dh_links(axes, placement_motion(placed))
    T = inverse(stands[-1]) @ tip_pose(path, [0.0] * len(turning))
    tool = placement(T[:3, :3].T @ T[:3, 3], T[:3, :3])
    notices: list[str] = []
    joints = tuple(_joint(joint, link, notices) for joint, link in zip(turning, [*links, None], strict=True))
    bodies = tuple(_bodies(robot, path, [*stands[1:], stands[-1]]))
    load = Body("load", 0.0, (0.0, 0.0, 0.0), len(joints) + 1, len(joints), carries_payload=True)
    arm = Arm(name or robot.name, GRAVITY, placed, joints, tool, (*bodies, load))
    if not bodies:
        notices.append("no link has a mass: what bends under its own weight cannot be found")
    raise_faults(robot.path, [FileError(robot.path, "", *fault) for fault in implausible(arm, "metres")])
    difference = largest_difference(model_of(arm, ()), path)
    if not difference < AGREES:
        raise FileError(robot.path, "", f"the arm is {difference:.2g} m or rad off the URDF's own kinematics")
    return ImportedArm(arm, base, tip, difference, tuple(notices))


def _check_serial(robot: Urdf, path: Sequence[UrdfJoint]) -> None:
    for joint in path:
        if not joint.turns and joint.kind != "fixed":
            what = f"is {joint.kind or 'of no type'}"
            raise FileError(robot.path, f"joint {joint.name}", what, "an arm has revolute joints; give --base or --tip")
    count = sum(joint.turns for joint in path)
    if not 1 <= count <= MOST_JOINTS:
        what = f"{count} joints between base and tip"
        raise FileError(robot.path, "", what, f"1 to {MOST_JOINTS}; see --base, --tip")


def _axis_frames(path: Sequence[UrdfJoint]) -> Iterator[Array]:
    """Frames of the turning joints (4, 4) in the base link's whose z is its axis, all angles zero."""
    pose = np.eye(4)
    for joint in path:
        pose = pose @ joint.origin
        if joint.turns:
            yield pose @ axis_to_z(joint.axis)


def axis_to_z(axis: Vector3) -> Array:
    """(4, 4), the smallest rotation that takes z to a unit axis."""
    across = np.array([-axis[1], axis[0], 0.0])
    sine = float(np.linalg.norm(across))
    if sine < 1e-15:
        return np.eye(4) if axis[2] > 0 else turn((1.0, 0.0, 0.0), math.pi)
    return turn((across / sine).tolist(), math.atan2(sine, axis[2]))


def _joint(joint: UrdfJoint, link: DhLink | None, notices: list[str]) -> Joint:
    link = link or DhLink(0.0, 0.0, 0.0, 0.0, 0.0)
    lower, upper = max(joint.lower, -2.0 * math.pi), min(joint.upper, 2.0 * math.pi)
    if (lower, upper) != (joint.lower, joint.upper):
        notices.append(f"{joint.name}: limits cut to one turn either way")
    return Joint(link.theta, link.d, link.a, link.alpha, None, lower, upper, beta=link.beta, name=joint.name)


def _bodies(robot: Urdf, path: Sequence[UrdfJoint], far: Sequence[Array]) -> Iterator[Body]:
    """One body per part that moves as one: what a joint carries, with all that is fixed to it.

    `far`: (4, 4) each, the frame at the far end of every link at zero; of the last link, that of its own axis.
    """
    pose, number = np.eye(4), 0
    gathered: dict[int, list[UrdfMass]] = {}
    for position, joint in enumerate(path):
        pose = pose @ joint.motion(0.0)
        number += joint.turns
        onward = path[position + 1].child if position + 1 < len(path) else ""
        for link, place in robot.carried_by(joint.child, without=onward):
            mass = robot.links[link]
            if mass is not None and number:
                com = inverse(far[number - 1]) @ pose @ place @ np.array([*mass.com, 1.0])
                x, y, z = com[:3].tolist()
                gathered.setdefault(number, []).append(UrdfMass(mass.mass, (x, y, z)))
    names = [joint.child for joint in path if joint.turns]
    for joint_number, masses in gathered.items():
        weights = np.array([mass.mass for mass in masses])
        x, y, z = (weights @ np.array([mass.com for mass in masses]) / weights.sum()).tolist()
        yield Body(names[joint_number - 1], float(weights.sum()), (x, y, z), joint_number, joint_number)


def largest_difference(model: Model, path: Sequence[UrdfJoint], seed: int = 0) -> float:
    """The largest element by which a rigid model's tool frame (rotation, or m) differs from the URDF's own kinematics.

    At random angles within the arm's limits. `path`: the joints from base to tip.
    """
    lower, upper = np.array([(joint.lower, joint.upper) for joint in model.arm.joints]).T
    q = np.random.default_rng(seed).uniform(lower, upper, (CHECKED, model.arm.dof))
    values: list[Number] = [np.full(CHECKED, amount) for amount in model.binding.constants]
    for k, angles in zip(model.chain.joint_slots, q.T, strict=True):
        values[k] = values[k] + angles
    ours = frames(model.chain, values, CHECKED)[:, -1]
    theirs = np.array([tip_pose(path, angles) for angles in q.tolist()])
    return float(np.abs(ours - theirs).max())
