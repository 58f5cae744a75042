"""The arm between two links of a URDF: axes to modified Denavit–Hartenberg links, centres of mass with them.

Between skew or crossing axes the frames stand on the common normal (Denavit & Hartenberg 1955). Between nearly parallel
ones its feet run off to infinity; there the frames stay where the description has them, and the angle beta takes the
rest (Hayati & Mirmirani 1985).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.data.rigid_motion import inverse, placement, placement_motion, shift, turn
from lrm_ident.data.robot_files.arm_end import choose_tip, gripper_notices
from lrm_ident.data.robot_files.heavy_masses import signs_of_heavy_masses
from lrm_ident.data.robot_files.urdf import Urdf, UrdfJoint, UrdfMass, tip_pose, with_followers
from lrm_math.arm.arm import MOST_JOINTS, NEARLY_PARALLEL, Arm, Body, Joint, MimicJoint, within_mimics
from lrm_math.arm.plausible_arm import ImplausibleArm, implausible
from lrm_math.arrays import Array, Vector3
from lrm_math.errors import FileError, LrmError, raise_faults
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.forward import frames
from lrm_math.model.model import Model, model_of

MOST_TURN = 4.0 * math.pi
"""rad: no joint of an arm turns farther either way, but for one that turns on and on."""
CHECKED = 200
"""Random poses at which the imported arm is compared with the URDF's own kinematics."""
AGREES = 1e-9
"""m and rad: a larger difference is a fault of the import, and refused."""
SAME = 1e-14
"""m or rad: what round-off alone makes of a zero."""


@dataclass(frozen=True)
class DhLink:
    """Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta); rad and m."""

    theta: float
    d: float
    a: float
    alpha: float
    beta: float

    @property
    def motion(self) -> Array:
        """(4, 4), from the frame on one axis to that on the next."""
        along = turn((0, 0, 1), self.theta) @ shift((self.a, 0.0, self.d))
        return along @ turn((1, 0, 0), self.alpha) @ turn((0, 1, 0), self.beta)


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


def import_arm(
    robot: Urdf,
    base: str | None = None,
    tip: str | None = None,
    name: str | None = None,
    accept: Collection[str] = (),
) -> ImportedArm:
    """The arm from the link `base` (None: the root) to the link `tip` (None: the only one, without a gripper).

    `accept`: rules of plausibility that a person knows it to break.
    Raises `FileError`: an implausible arm, a chain that is not one of revolute joints, or one that the import does not
    reproduce.
    """
    base = base or robot.root
    notices = list(robot.notices)
    if not tip:
        tip = choose_tip(robot, base)
        notices.extend(gripper_notices(robot, tip))
    path = robot.chain(base, tip)
    check_serial(robot, path)
    turning = [joint for joint in path if joint.turns]
    axes = list(_axis_frames(path))
    placed = replace(placement(axes[0][:3, 3], axes[0][:3, :3]), gamma=0.0)
    links, stands = dh_links(axes, placement_motion(placed))
    T = inverse(stands[-1]) @ tip_pose(path, [0.0] * len(turning))
    tool = placement(T[:3, :3].T @ T[:3, 3], T[:3, :3])
    every = [_joint(joint, link, notices) for joint, link in zip(turning, [*links, None], strict=True)]
    mimics = tuple(_mimics(turning, every))
    commanded = [link for joint, link in zip(turning, every, strict=True) if joint.commanded]
    bodies = tuple(_bodies(robot, path, [*stands[1:], stands[-1]]))
    load = Body("load", 0.0, (0.0, 0.0, 0.0), len(every) + 1, len(every), carries_payload=True)
    try:
        joints = within_mimics(commanded, mimics)
    except LrmError as error:
        raise FileError(robot.path, "", str(error)) from None
    notices.extend(_narrowed(commanded, joints, mimics))
    gravity = _gravity(robot, base, notices)
    arm = Arm(name or robot.name, gravity, placed, joints, tool, (*bodies, load), mimics=mimics)
    notices.extend(_rods(robot, path))
    if not bodies:
        notices.append("no link has a mass: what bends under its own weight cannot be found")
    unweighed = [ImplausibleArm("mass", robot.unweighed, "put it there")] if robot.unweighed else []
    notices.extend(fault.what for fault in unweighed)
    broken = [
        *unweighed,
        *implausible(arm, "metres"),
        *_limits_in_degrees(turning),
        *_angles_in_degrees(robot, path),
        *_heavy(arm, robot, path, notices),
    ]
    faults = [fault for fault in broken if fault.rule not in accept]
    raise_faults(robot.path, [FileError(robot.path, "", fault.what, _right(fault)) for fault in faults])
    arm = replace(arm, accepted=tuple(dict.fromkeys(fault.rule for fault in broken)))
    difference = largest_difference(model_of(arm, ()), path)
    if not difference < AGREES:
        raise FileError(robot.path, "", f"the arm is {difference:.2g} m or rad off the URDF's own kinematics")
    return ImportedArm(arm, base, tip, difference, tuple(notices))


def _narrowed(stated: Sequence[Joint], joints: Sequence[Joint], mimics: Sequence[MimicJoint]) -> Iterator[str]:
    """Notices of joints that turn less far than their own limits, since what follows them stops."""
    for number, (limited, other) in enumerate(zip(stated, joints, strict=True)):
        if (limited.lower, limited.upper) != (other.lower, other.upper):
            names = " and ".join(mimic.link.name for mimic in mimics if mimic.leader == number)
            was, after = (f"{math.degrees(j.lower):.4g} to {math.degrees(j.upper):.4g}" for j in (limited, other))
            yield f"{limited.name}: limits {was} deg become {after} deg, where {names} stops that follows it"


def _rods(robot: Urdf, path: Sequence[UrdfJoint]) -> Iterator[str]:
    """Notices of masses beside the arm that turn with its joints, as rods do: a body of an arm is fixed to a link."""
    chain = {joint.name for joint in path}
    for child, joint in robot.joints.items():
        leader = "" if joint.mimic is None else joint.mimic.leader
        if joint.name in chain or leader not in chain:
            continue
        if any(robot.links[link] is not None for link, _ in robot.carried_by(child, without="")):
            yield f"the mass of '{child}' beside the arm turns with joint {leader}: it counts as it stands at zero"


def _right(fault: ImplausibleArm) -> str:
    return f"{fault.right}; if that is your arm: --accept {fault.rule}"


def _limits_in_degrees(turning: Sequence[UrdfJoint]) -> Iterator[ImplausibleArm]:
    """The first joint whose limits (rad) are no turns of an arm, but would be in degrees."""
    for joint in turning:
        most = max(abs(joint.lower), abs(joint.upper))
        if MOST_TURN < most <= math.degrees(MOST_TURN):
            what = f"joint {joint.name}: limits {joint.lower:g} to {joint.upper:g} rad look like degrees"
            yield ImplausibleArm("limits", what, "limits are in radians")
            return


def _angles_in_degrees(robot: Urdf, path: Sequence[UrdfJoint]) -> Iterator[ImplausibleArm]:
    """The first joint whose place is turned by more than a full turn, as in degrees."""
    names = {joint.name for joint in path}
    for element in robot.tree.findall("joint"):
        origin = element.find("origin")
        rpy = "" if origin is None or element.get("name") not in names else origin.get("rpy", "")
        if any(abs(float(angle)) > MOST_TURN for angle in rpy.split()):
            what = f'joint {element.get("name")}: rpy="{rpy}" looks like degrees'
            yield ImplausibleArm("angles", what, "angles are in radians")
            return


def _heavy(arm: Arm, robot: Urdf, path: Sequence[UrdfJoint], notices: list[str]) -> Iterator[ImplausibleArm]:
    """Masses that are too large by two signs; a single one is a notice."""
    signs = list(signs_of_heavy_masses(arm, robot, path))
    if len(signs) == 1:
        notices.append(f"are the masses right? {signs[0]}")
    elif signs:
        yield ImplausibleArm("mass", f"the masses look too large: {'; '.join(signs)}", "masses are in kilograms")


def _gravity(robot: Urdf, base: str, notices: list[str]) -> Vector3:
    """Gravity in the frame of the link `base` (m/s²), which the file may hold to a wall or a ceiling."""
    x, y, z = (_clean(component) for component in (np.array(robot.gravity) @ robot.standing(base)[:3, :3]).tolist())
    if not any(robot.gravity):
        notices.append("the file has no gravity: nothing bends the arm")
    if x or y or z > 0.0:
        along = ", ".join(f"{component:.3g}" for component in (x, y, z))
        notices.append(f"gravity is {along} m/s2 along x, y, z of '{base}', as the file mounts it")
    return x, y, z


def check_serial(robot: Urdf, path: Sequence[UrdfJoint]) -> None:
    """Raises `FileError` for a chain (base to tip) that is not one of revolute joints, as many as an arm may have."""
    names = {joint.name for joint in path}
    for joint in path:
        if joint.mimic is not None and joint.fault is None and joint.mimic.leader not in names:
            what = f"follows joint {joint.mimic.leader}, which is not between base and tip"
            right = "an arm's joint follows one of the arm; see --base, --tip"
            raise FileError(robot.path, f"joint {joint.name}", what, right)
        if joint.fault:
            raise FileError(robot.path, f"joint {joint.name}", *joint.fault)
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


def dh_link(point: Array, axis: Array) -> DhLink:
    """The link from a frame whose z is one axis to the next axis: a `point` (3,), m, on it and its direction (3,)."""
    sine = float(np.hypot(axis[0], axis[1]))
    if sine < NEARLY_PARALLEL:
        return _parallel(point, axis)
    theta = math.atan2(-axis[1], -axis[0]) - math.pi / 2.0  # x along z × axis
    normal = np.array([math.cos(theta), math.sin(theta), 0.0])
    alpha = math.atan2(sine, axis[2])
    if theta < -math.pi / 2.0 or theta >= math.pi / 2.0:  # of the two directions of the normal, the smaller turn
        theta, alpha, normal = theta + math.copysign(math.pi, -theta), -alpha, -normal
    beyond = float(point @ np.cross((0.0, 0.0, 1.0), normal)) / (-math.sin(alpha))
    foot = point - beyond * axis
    return DhLink(theta, float(foot[2]), _clean(float(foot @ normal)), alpha, 0.0)


def _parallel(point: Array, axis: Array) -> DhLink:
    """The next frame stands at `point`; alpha and beta turn z into the axis."""
    a = float(np.hypot(point[0], point[1]))
    theta = math.atan2(point[1], point[0]) if a > SAME else 0.0
    if theta < -math.pi / 2.0 or theta >= math.pi / 2.0:
        theta, a = theta - math.copysign(math.pi, theta), -a
    x, y, z = (turn((0, 0, 1), -theta)[:3, :3] @ axis).tolist()
    beta = math.asin(x)
    return DhLink(_clean(theta), float(point[2]), a if abs(a) > SAME else 0.0, _clean(math.atan2(-y, z)), _clean(beta))


def dh_links(axes: Sequence[Array], start: Array) -> tuple[list[DhLink], list[Array]]:
    """Links between consecutive joint frames (4, 4), each turning about its z, and the frames of ours on their axes.

    `start`: (4, 4), the frame on the first axis. All in one fixed frame.
    """
    ours, links = [start], list[DhLink]()
    for after in axes[1:]:
        seen = inverse(ours[-1]) @ after
        links.append(dh_link(seen[:3, 3], seen[:3, 2]))
        ours.append(ours[-1] @ links[-1].motion)
    return links, ours


def _clean(value: float) -> float:
    return value if abs(value) > SAME else 0.0


def _joint(joint: UrdfJoint, link: DhLink | None, notices: list[str]) -> Joint:
    extra_z = None if link is None else 0.0  # the tool's position says the same of the last link
    link = link or DhLink(0.0, 0.0, 0.0, 0.0, 0.0)
    lower, upper = max(joint.lower, -2.0 * math.pi), min(joint.upper, 2.0 * math.pi)
    if joint.mimic is not None and not joint.lower < joint.upper:
        lower, upper = -2.0 * math.pi, 2.0 * math.pi
        notices.append(f"{joint.name}: states no limits of its own: those of {joint.mimic.leader} hold")
    elif (lower, upper) != (joint.lower, joint.upper):
        notices.append(f"{joint.name}: limits {joint.lower:g} to {joint.upper:g} rad cut to one turn either way")
    return Joint(link.theta, link.d, link.a, link.alpha, extra_z, lower, upper, beta=link.beta, name=joint.name)


def _mimics(turning: Sequence[UrdfJoint], links: Sequence[Joint]) -> Iterator[MimicJoint]:
    """The joints that follow others, outwards. `links`: of all turning joints."""
    motors = [joint.name for joint in turning if joint.commanded]
    for k, (joint, link) in enumerate(zip(turning, links, strict=True)):
        if joint.mimic is not None:
            after = sum(before.commanded for before in turning[:k])
            yield MimicJoint(link, after, motors.index(joint.mimic.leader), joint.mimic.ratio, joint.mimic.offset)


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
    theirs = np.array([tip_pose(path, with_followers(path, angles)) for angles in q.tolist()])
    return float(np.abs(ours - theirs).max())
