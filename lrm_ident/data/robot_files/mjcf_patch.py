"""A robot's own MJCF that behaves like one arm: frames, springs, play and friction of a model in it, the rest kept.

Frames are corrected as those of a URDF. A joint's compliance k is its position actuator with kp = 1/k. What else bends
is a hinge more with stiffness 1/k, play b one with the range ±b/2 and no spring. Hysteresis h behind a servo that lags
is dry friction of ½|h|/k: what the servo's spring must overcome. Weights are those that the model was fitted with,
without which its springs would bend otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import accumulate
from os.path import relpath
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike

from lrm_ident.data.rigid_motion import inverse, quaternions
from lrm_ident.data.robot_files.arm_end import choose_tip
from lrm_ident.data.robot_files.mjcf import (
    HARDEST,
    SPRINGS,
    add_play,
    angle_unit,
    play_of_leaders,
    slot_motions,
    spring_stiffness,
    static_play,
)
from lrm_ident.data.robot_files.mjcf_robot import MjcfRobot
from lrm_ident.data.robot_files.urdf import Urdf, UrdfJoint, parse_urdf
from lrm_ident.data.robot_files.urdf_export import CALIBRATED, ExportedFile, corrected_urdf, left_out, rigid_part
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.model.model import Model

SPRING_DAMPING = 0.1
"""N·m·s/rad, of the hinges that are added."""
HELD = (*SPRINGS, "backlash", "hysteresis", "mass", "gravity")
"""Effects that MuJoCo has, beside constant ones, where the file has what they act on."""
UNCHANGED = 1e-12
LEAST_MASS, LEAST_INERTIA = 1e-6, 1e-9
"""kg, kg·m²: of a part that moves and has no mass."""
SAME = 1e-9
"""kg, kg·m."""


def patched_mjcf(
    model: Model, robot_file: MjcfRobot, output: Path, base: str | None = None, tip: str | None = None
) -> ExportedFile:
    """The robot's file with a model in it, to be written as `output` (meshes are found from there).

    `robot_file` is changed. Raises `FileError`: the file is not of the model's arm.
    """
    robot = robot_file.robot
    base = base or robot.root
    tip = tip or choose_tip(robot, base)
    corrected = parse_urdf(robot.path, corrected_urdf(rigid_part(model), robot, base, tip))
    path = corrected.chain(base, tip)
    for joint in path:
        if joint.turns and joint.child not in robot_file.bodies:
            what = "turns a body that another joint turns, too"
            raise FileError(
                robot_file.path, f"joint {joint.name}", what, "give each joint a body of its own, or export a URDF"
            )
        _place(robot_file, joint)
    if f"{tip}{CALIBRATED}" in corrected.joints:
        behind = robot_file.anchor(robot_file.bodies[tip]) @ corrected.joints[f"{tip}{CALIBRATED}"].origin
        robot_file.spec_body(tip).add_site(name=f"{tip}{CALIBRATED}", **_placed(behind))
    gravity = robot_file.robot.standing(base)[:3, :3] @ model.constant_gravity
    if np.abs(gravity - robot_file.spec.option.gravity).max() > UNCHANGED:
        robot_file.spec.option.gravity = gravity
    lost = (*_servos(model, robot_file, path), *weigh(model, robot_file, corrected, path), *left_out(model, HELD))
    places = static_play(model)
    turning = zip(model.arm.joint_names, (joint.name for joint in path if joint.commanded), strict=True)
    play = {name: places.get(place, 0.0) for place, name in turning}
    text = _text(robot_file, output, _add_springs(model, robot_file, path), play)
    return ExportedFile(text, f"{robot_file.path.name} with the model in it", lost)


def _text(robot_file: MjcfRobot, output: Path, ahead: Mapping[str, Sequence[str]], play: Mapping[str, float]) -> str:
    """Text of the changed file, which finds meshes and textures from the output's folder.

    `ahead`: by joint, other joints of the body that turn it first; MuJoCo's `MjSpec` puts new ones last. `play`: rad.
    """
    tree = ElementTree.fromstring(robot_file.spec.to_xml())
    for body in tree.iter("body"):
        joints = {joint.get("name", ""): joint for joint in body.findall("joint")}
        for name in joints.keys() & ahead.keys():
            for first in ahead[name]:
                body.remove(joints[first])
                body.insert(list(body).index(joints[name]), joints[first])
        for name in joints.keys() & play.keys():
            add_play(body, name, play[name], angle_unit(tree))
    for compiler in tree.findall("compiler"):
        if output.parent.resolve() != robot_file.path.parent.resolve():
            for folder in ("meshdir", "texturedir"):
                compiler.set(folder, relpath(robot_file.path.parent / getattr(robot_file.spec, folder), output.parent))
    return ElementTree.tostring(tree, encoding="unicode") + "\n"


def _place(robot_file: MjcfRobot, joint: UrdfJoint) -> None:
    """Puts a body, or the tip's site, where a joint of the corrected robot has it."""
    before = robot_file.robot.joints[joint.child].origin
    if np.abs(before - joint.origin).max() < UNCHANGED:
        return
    stands = robot_file.anchor(robot_file.bodies[joint.parent]) @ joint.origin
    if joint.child in robot_file.bodies:
        child = robot_file.bodies[joint.child]
        stands = stands @ inverse(robot_file.zero(child)) @ inverse(robot_file.anchor(child))
        element = robot_file.spec_body(joint.child)
    else:
        element = robot_file.spec.site(joint.child)
    if element.frame is not None:
        element.set_frame(element.parent.add_frame())
    element.alt.type = 0  # mjORIENTATION_QUAT
    for name, value in _placed(stands).items():
        setattr(element, name, value)


def _placed(T: Array) -> dict[str, Array]:
    """Position (m) and quaternion of a pose (4, 4), by MuJoCo's names."""
    return {"pos": T[:3, 3], "quat": quaternions(T[None, :3, :3])[0]}


def _servos(model: Model, robot_file: MjcfRobot, path: Sequence[UrdfJoint]) -> Iterator[str]:
    """Gives the joints their compliance and friction; yields what they cannot have."""
    turning, stiffness = [joint for joint in path if joint.commanded], spring_stiffness(model)
    yield from play_of_leaders(model)
    for number, joint in enumerate(turning):
        slot = model.chain.joint_slots[number]
        place = model.arm.joint_names[number]
        actuator = next((a for a in robot_file.spec.actuators if a.target == joint.name and a.biasprm[1] < 0.0), None)
        if slot in stiffness and actuator is None:
            yield f"compliance@{place} (no position actuator on {joint.name})"
        if slot in stiffness and actuator is not None:
            actuator.gainprm[0], actuator.biasprm[1] = stiffness[slot], -stiffness[slot]
        h = _value(model, "hysteresis", place)
        if h > 0.0 or (h < 0.0 and actuator is None):
            yield f"hysteresis@{place} ({'it overshoots' if h > 0.0 else f'no position actuator on {joint.name}'})"
        elif h < 0.0 and actuator is not None:
            robot_file.spec.joint(joint.name).frictionloss = -0.5 * h * float(actuator.gainprm[0])
            robot_file.spec.joint(joint.name).solimp_friction[:2] = HARDEST


def _add_springs(model: Model, robot_file: MjcfRobot, path: Sequence[UrdfJoint]) -> dict[str, list[str]]:
    """Adds a hinge for what bends beside the joints; names of those that come before a joint, by its name.

    What bends before a link's own weight is borne by the next joint's body, before its turn.
    """
    places, carriers = places_at_zero(model), carriers_of(path)
    turning = [joint for joint in path if joint.turns]
    ahead: dict[str, list[str]] = {}
    for k, stiffness in sorted(spring_stiffness(model).items()):
        slot, number = model.chain.slots[k], joints_before(model, k)
        if slot.joint is not None:
            continue
        if bends_own_weight(model, k) or number == len(turning):
            joint, stands = turning[number - 1], carriers[number - 1]
            local = robot_file.anchor(robot_file.bodies[joint.child]) @ inverse(stands) @ places[k]
        else:
            joint, stands = turning[number], carriers[number]
            child = robot_file.bodies[joint.child]
            local = robot_file.anchor(child) @ robot_file.zero(child) @ inverse(stands) @ places[k]
            ahead.setdefault(joint.name, []).append(slot.key)
        _add_hinge(robot_file, joint.child, slot.key, local[:3, 3], local[:3, slot.axis], stiffness)
    return ahead


def _add_hinge(robot_file: MjcfRobot, link: str, name: str, anchor: Array, axis: Array, stiffness: float) -> None:
    """A joint more of a body: a spring (N·m/rad)."""
    body = robot_file.spec_body(link)
    hinge = body.add_joint(name=name, pos=anchor, axis=axis)
    hinge.stiffness = _linear(stiffness, hinge.stiffness)
    hinge.damping = _linear(SPRING_DAMPING, hinge.damping)
    if robot_file.compiled.body_subtreemass[robot_file.bodies[link]] <= 0.0:
        body.mass, body.inertia, body.explicitinertial = LEAST_MASS, np.full(3, LEAST_INERTIA), True


def _linear(value: float, before: ArrayLike) -> ArrayLike:
    """A coefficient of a joint, for MuJoCo from 4.0 on the first one of a polynomial."""
    return value if np.ndim(before) == 0 else np.concatenate([[value], np.zeros(np.size(before) - 1)])


def _value(model: Model, effect: str, place: str) -> float:
    """First parameter of an effect at a joint; 0 without it."""
    return next(
        (
            values[0]
            for effect_there, values in model.parts()
            if (effect_there.id, effect_there.place) == (effect, place)
        ),
        0.0,
    )


def places_at_zero(model: Model) -> list[Array]:
    """(4, 4) each, the frame of every slot of a model's chain, and of its end, the arm at zero."""
    return list(accumulate(slot_motions(model), np.matmul, initial=np.eye(4)))


def joints_before(model: Model, k: int) -> int:
    """Number of joints before slot k of a model's chain, those that follow others included."""
    return sum(slot < k for slot in model.chain.turning_slots)


def bends_own_weight(model: Model, k: int) -> bool:
    """Whether slot k of a model's chain moves a body that the last joint before it carries itself."""
    number = joints_before(model, k)
    return number > 0 and any(
        body.before > k and joints_before(model, body.before) == number for body in model.chain.bodies
    )


def carriers_of(path: Sequence[UrdfJoint]) -> list[Array]:
    """(4, 4) each, frames of the links that joints 1 … n of a path carry, the arm at zero."""
    out, pose = [], np.eye(4)
    for joint in path:
        pose = pose @ joint.origin
        if joint.turns:
            out.append(pose)
    return out


def weigh(model: Model, robot_file: MjcfRobot, robot: Urdf, path: Sequence[UrdfJoint]) -> Iterator[str]:
    """Gives what each joint carries the model's mass and centre of mass, by its heaviest part; yields what cannot be.

    `robot`: the corrected one. `path`: its joints from base to tip.
    """
    moments, links = _moments(model), [joint.child for joint in path if joint.turns]
    onward = [*links[1:], ""]
    for number, (link, stands, without) in enumerate(zip(links, carriers_of(path), onward, strict=True), start=1):
        parts = [(name, where, robot.links[name]) for name, where in robot.carried_by(link, without)]
        heavy = [(name, where, mass) for name, where, mass in parts if mass is not None and name in robot_file.bodies]
        has = sum((mass.mass * (where @ np.array([*mass.com, 1.0])) for _, where, mass in heavy), np.zeros(4))
        lacks = inverse(stands) @ moments[number] - has
        if np.abs(lacks).max() < SAME:
            continue
        name, where, mass = max(heavy, key=lambda part: part[2].mass, default=(link, np.eye(4), None))
        moment = inverse(where) @ lacks + (0.0 if mass is None else mass.mass * np.array([*mass.com, 1.0]))
        if moment[3] <= 0.0:
            yield f"the weight of {name}"
        else:
            _set_mass(robot_file, name, moment)


def _moments(model: Model) -> dict[int, Array]:
    """First mass moment (kg m) and mass (kg) (4,) of what each joint carries up to the next, the arm at zero."""
    places = places_at_zero(model)
    out = {number: np.zeros(4) for number in range(len(model.arm.links) + 1)}
    for body, weight in zip(model.chain.bodies, model.weights(0.0), strict=True):
        moment = places[body.before] @ np.array([*map(float, weight.com), 1.0])
        out[joints_before(model, body.before)] += float(weight.mass) * moment
    return out


def _set_mass(robot_file: MjcfRobot, link: str, moment: Array) -> None:
    number, body = robot_file.bodies[link], robot_file.spec_body(link)
    compiled = robot_file.compiled
    body.mass, body.ipos = float(moment[3]), moment[:3] / moment[3] + robot_file.anchor(number)[:3, 3]
    body.inertia, body.iquat = compiled.body_inertia[number], compiled.body_iquat[number]
    body.fullinertia, body.ialt.type, body.explicitinertial = np.full(6, np.nan), 0, True
