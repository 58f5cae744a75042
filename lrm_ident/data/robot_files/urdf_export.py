"""A URDF that matches one arm: the rigid part of a model in every `<origin>` of the chain.

Joint i of the URDF stands at U_i = F_i K_i: F_i is our frame on its axis at zero, K_i a turn about that axis, a shift
along it and the choice of z. A calibrated model has other frames F'_i, and a zero offset δ_i is a turn about the axis:
U'_i = F'_i Rz(δ_i) K_i. Each origin is then the pose of U'_i in its parent link.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from lrm_ident.data.rigid_motion import inverse, shift, turn
from lrm_ident.data.robot_files.arm_end import choose_tip
from lrm_ident.data.robot_files.urdf import Urdf, UrdfJoint, append_joint, numbers, parse_urdf, set_origin
from lrm_ident.data.robot_files.urdf_arm import axis_to_z, check_serial, largest_difference
from lrm_ident.data.wording import joint_labels
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array, Vector3
from lrm_math.effects import constant
from lrm_math.errors import FileError
from lrm_math.kinematics.chain import Chain, Number
from lrm_math.kinematics.forward import frames
from lrm_math.model.model import Model, model_of

ANOTHER_ARM = 2e-3
"""m, or rad: an arm file that is off the URDF by more describes another arm, or another tip."""
WORLD = "world"
CALIBRATED = "_calibrated"
"""Ending of the link that is added where no fixed joint leads to the tip."""
BALL = 0.03
"""m, radius of the ball whose moment of inertia stands for that of a body, which is not measured."""


@dataclass(frozen=True)
class ExportedFile:
    """Text of a file, what it is, and what of the model, `effect@place`, it cannot hold, some with the reason.

    `advice`: what a person may do about that.
    """

    text: str
    what: str
    left_out: tuple[str, ...]
    advice: str = ""


def rigid_part(model: Model, keep: Sequence[str] = ()) -> Model:
    """The model with its constant effects only; those at the places `keep` (base, tool) as drawn."""
    kept = [effect for effect in model.effects if constant(effect)]
    names = [key for effect in kept if effect.place not in keep for key in effect.keys]
    return model_of(model.arm, kept, {name: model.value(name) for name in names})


def left_out(model: Model, held: Collection[str] = ()) -> tuple[str, ...]:
    """Effects of a model, `effect@place`, that act but that no `<origin>` can hold, nor the file as those `held`."""
    acting = [effect for effect in model.effects if any(model.value(key) != 0.0 for key in effect.keys)]
    return tuple(effect.name for effect in acting if not (constant(effect) or effect.id in held))


def corrected_urdf(model: Model, robot: Urdf, base: str | None = None, tip: str | None = None) -> str:
    """Text of the URDF with the model's rigid part in the origins between two links; all else stays as it is.

    Raises `FileError`: the URDF is not of the model's arm.
    """
    base = base or robot.root
    tip = tip or choose_tip(robot, base)
    path = robot.chain(base, tip)
    check_serial(robot, path)
    turning = [joint for joint in path if joint.turns]
    if [joint.commanded for joint in turning] != [mimic is None for _, _, mimic in model.arm.chain_order]:
        what = f"{_counted(turning)} between '{base}' and '{tip}', {model.arm.name} has {_counted_of(model.arm)}"
        raise FileError(robot.path, "", what, "is this another arm? see --base and --tip")
    off = largest_difference(model_of(model.arm, ()), path)
    if not off < ANOTHER_ARM:
        what = f"{model.arm.name} is up to {off * 1e3:.3g} mm (or mrad) off this URDF's own kinematics"
        raise FileError(robot.path, "", what, "is this another arm, or another tip? see --base and --tip")
    origins = _origins(model, path)
    tree = deepcopy(robot.tree)
    for element in tree.findall("joint"):
        name = element.get("name") or ""
        if name in origins:
            set_origin(element, origins[name])
    if "" in origins:
        ElementTree.SubElement(tree, "link", name=f"{tip}{CALIBRATED}")
        append_joint(tree, f"{tip}{CALIBRATED}_joint", "fixed", tip, f"{tip}{CALIBRATED}", origins[""])
    return _text(tree)


def _counted(turning: Sequence[UrdfJoint]) -> str:
    following = sum(not joint.commanded for joint in turning)
    return f"{len(turning)} joints{f', {following} of which follow others,' if following else ''}"


def _counted_of(arm: Arm) -> str:
    return f"{len(arm.links)}{f', {len(arm.mimics)} of which follow others' if arm.mimics else ''}"


def bare_urdf(arm: Arm) -> Urdf:
    """A URDF of an arm as drawn: links with their masses, no meshes."""
    chain = chain_frames(model_of(arm, ()))
    tree = ElementTree.Element("robot", name=arm.name)
    names = joint_labels(arm)
    links = ["base_link", *(f"link{i}" for i in range(1, len(arm.links) + 1)), "tcp"]
    for number, link in enumerate(links):
        _append_link(tree, arm, link, number)
    before = np.eye(4)
    for number, (place, joint, mimic) in enumerate(arm.chain_order):
        origin = inverse(before) @ chain[number]
        element = append_joint(tree, joint.name or place, "revolute", links[number], links[number + 1], origin)
        ElementTree.SubElement(element, "axis", xyz="0 0 1")
        limits = {"lower": repr(joint.lower), "upper": repr(joint.upper)}
        ElementTree.SubElement(element, "limit", {**limits, "effort": "10", "velocity": "10"})
        if mimic is not None:
            linear = {"multiplier": repr(mimic.ratio), "offset": repr(mimic.offset)}
            ElementTree.SubElement(element, "mimic", {"joint": names[mimic.leader], **linear})
        before = chain[number]
    append_joint(tree, "tcp_joint", "fixed", links[-2], links[-1], inverse(before) @ chain[-1])
    return parse_urdf(Path(f"{arm.name}.urdf"), _text(tree))


def mounted(text: str, gravity: Vector3) -> str:
    """Text of a URDF whose root is held by a link `world`, so that gravity, in the root's frame (m/s²), points down.

    Unchanged where it does already.
    """
    size = math.hypot(*gravity)
    if not size or gravity == (0.0, 0.0, -size):
        return text
    tree = ElementTree.fromstring(text.partition("?>")[2])
    root = parse_urdf(Path("written.urdf"), text).root
    x, y, z = (-component / size for component in gravity)
    ElementTree.SubElement(tree, "link", name=WORLD)
    append_joint(tree, f"{WORLD}_joint", "fixed", WORLD, root, inverse(axis_to_z((x, y, z))))
    return _text(tree)


def chain_frames(model: Model) -> Array:
    """(L + 1, 4, 4), world frames of a rigid model, every joint at zero, that follows another one or not: before each
    joint's turn, the zero offset in it; the tool.

    The nominal theta of a joint is not in its frame, so that only its error turns it.
    """
    chain = model.chain
    stands = frames(chain, every_joint_at_zero(model), 1)[0]
    real, drawn = chain.driven(list(model.binding.constants)), chain.driven([slot.nominal for slot in chain.slots])
    turns = (chain.index[f"{place}.theta"] for place in model.arm.link_places)
    turned = [F @ turn((0, 0, 1), float(real[k] - drawn[k])) for F, k in zip(stands, turns, strict=False)]
    return np.array([*turned, stands[-1]])


def every_joint_at_zero(model: Model) -> list[Number]:
    """Own amounts of the slots where joints that follow others stand at zero, too, instead of at their offset."""
    values: list[Number] = list(model.binding.constants)
    for (k, _, _), mimic in zip(model.chain.couplings, model.arm.mimics, strict=True):
        values[k] = values[k] - mimic.offset
    return values


def zero_offset(model: Model, chain: Chain, i: int) -> float:
    """Angle of joint i, from 0, where it is commanded zero (rad)."""
    k = chain.joint_slots[i]
    return float(model.binding.constants[k]) - chain.slots[k].nominal


def _origins(model: Model, path: Sequence[UrdfJoint]) -> dict[str, Array]:
    """New `<origin>` (4, 4) of joints of the chain by name; '' is one that has to be added behind the tip."""
    drawn, corrected = (chain_frames(variant) for variant in (model_of(model.arm, ()), model))
    out: dict[str, Array] = {}
    nominal, parent, number = np.eye(4), np.eye(4), 0
    behind = np.eye(4)  # fixed joints since the last turning one, as drawn
    last_fixed = ""
    for joint in path:
        nominal = nominal @ joint.origin
        behind = behind @ joint.origin
        last_fixed = "" if joint.turns else joint.name
        if joint.turns:
            stands = corrected[number] @ _in_axis_frame(drawn[number], nominal, joint)
            fixed = behind @ inverse(joint.origin)
            out[joint.name] = inverse(parent @ fixed) @ stands
            parent, behind, number = stands, np.eye(4), number + 1
    tip = inverse(parent) @ corrected[-1]
    if last_fixed:
        out[last_fixed] = inverse(behind @ inverse(path[-1].origin)) @ tip
    elif np.abs(tip - behind).max() > 1e-15:
        out[""] = tip
    return out


def _in_axis_frame(axis_frame: Array, stands: Array, joint: UrdfJoint) -> Array:
    """K (4, 4): a URDF joint frame in our frame on its axis; the axis is met exactly."""
    to_axis = axis_to_z(joint.axis)
    M = inverse(axis_frame) @ stands @ to_axis
    return turn((0, 0, 1), math.atan2(M[1, 0], M[0, 0])) @ shift((0.0, 0.0, M[2, 3])) @ inverse(to_axis)


def _append_link(tree: ElementTree.Element, arm: Arm, name: str, number: int) -> None:
    """A link with the bodies that move with it; the frame of link i is that before the turn of joint i."""
    link = ElementTree.SubElement(tree, "link", name=name)
    bodies = [body for body in arm.bodies if body.mass and min(body.frame, len(arm.links)) == number]
    if not bodies or not number:
        return
    stands = _body_frames(arm)
    drawn_frame = inverse(chain_frames(model_of(arm, ()))[number - 1])
    mass = sum(body.mass for body in bodies)
    centre = (
        sum(body.mass * (drawn_frame @ stands[body.name] @ np.array([*body.com, 1.0]))[:3] for body in bodies) / mass
    )
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", xyz=numbers(centre), rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=repr(float(mass)))
    moment = repr(0.4 * float(mass) * BALL**2)
    diagonal = dict.fromkeys(("ixx", "iyy", "izz"), moment) | dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    ElementTree.SubElement(inertial, "inertia", diagonal)


def _body_frames(arm: Arm) -> dict[str, Array]:
    """(4, 4) of every body: the frame that its centre of mass is given in, every joint at zero."""
    model, last = model_of(arm, ()), len(arm.links)
    stands = frames(model.chain, every_joint_at_zero(model), 1)[0]
    out = {}
    for body in arm.bodies:
        extra = arm.links[body.frame - 1].extra_z or 0.0 if 0 < body.frame <= last else 0.0
        lifted = body.near_end and 0 < body.frame <= last
        at_tool = shift((0.0, 0.0, -arm.tool.z)) if body.near_end and body.frame == last + 1 else np.eye(4)
        out[body.name] = stands[body.frame] @ (shift((0.0, 0.0, -extra)) if lifted else at_tool)
    return out


def _text(tree: ElementTree.Element) -> str:
    ElementTree.indent(tree)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(tree, encoding="unicode") + "\n"


def exported_difference(model: Model, text: str, base: str | None, tip: str | None) -> float:
    """Largest difference of a written URDF's own kinematics from the rigid model's (m, or rad), at random poses."""
    robot = parse_urdf(Path("written.urdf"), text)
    base = base or robot.root
    corrected_links = [link for link in robot.links if link.endswith(CALIBRATED)]
    return largest_difference(
        model, robot.chain(base, corrected_links[0] if corrected_links else tip or choose_tip(robot, base))
    )
