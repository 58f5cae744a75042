"""MJCF (MuJoCo) of a model: what is rigid as bodies, what bends as springs, play as a joint with a range.

A servo that holds an angle with a spring of compliance k is a position actuator with kp = 1/k; a link or base that
bends is a hinge with stiffness 1/k; play b is a hinge with the range ±b/2 and no spring.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from lrm_ident.data.rigid_motion import quaternions, shift, turn
from lrm_ident.data.robot_files.urdf import numbers
from lrm_ident.data.robot_files.urdf_export import BALL, ExportedFile, every_joint_at_zero, left_out
from lrm_ident.data.wording import joint_labels
from lrm_math.arm.arm import Arm, MimicJoint
from lrm_math.arrays import Array
from lrm_math.effects.compliance import LateralCompliance
from lrm_math.kinematics.chain import Slot
from lrm_math.model.model import Model

RIGID_KP = 1e4
"""N·m/rad, of joints to which the model gives no compliance: a thousand times that of a printed arm."""
SPRINGS = ("compliance", "base_compliance", "lateral_compliance")
HELD = (*SPRINGS, "backlash", "mass", "payload", "gravity")
"""Effects that the file holds, beside constant ones."""
LED = "others follow its servo alone"


def mjcf(model: Model) -> ExportedFile:
    """The MJCF of a model."""
    chain = model.chain
    springs, play = spring_stiffness(model), static_play(model)
    root = ElementTree.Element("mujoco", model=model.arm.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    ElementTree.SubElement(root, "option", gravity=numbers(model.constant_gravity))
    parent = ElementTree.SubElement(root, "worldbody")
    actuators = ElementTree.SubElement(root, "actuator")
    pose, body, carriers = np.eye(4), 0, []
    weights, motions = model.weights(0.0), slot_motions(model)
    followed = {k: (mimic, springs.get(k)) for (k, _, _), mimic in zip(chain.couplings, model.arm.mimics, strict=True)}
    equality = ElementTree.Element("equality")
    for k, slot in enumerate(chain.slots):
        while body < len(chain.bodies) and chain.bodies[body].before == k:
            carriers.append((parent, pose, body))
            body += 1
        joint = slot.joint
        if k in followed:
            parent = ElementTree.SubElement(parent, "body", {"name": slot.key, **_placed(pose)})
            pose = np.eye(4)
            _add_follower(parent, equality, model, slot, *followed[k])
        elif joint is not None or k in springs:
            parent = ElementTree.SubElement(parent, "body", {"name": slot.key, **_placed(pose)})
            pose = np.eye(4)
            axis = numbers(np.eye(3)[slot.axis])
            if joint is None:
                ElementTree.SubElement(
                    parent, "joint", name=slot.key, axis=axis, stiffness=repr(springs[k]), damping="0.1"
                )
            else:
                _add_servo(parent, actuators, model, joint, axis, springs.get(k, RIGID_KP), play.get(slot.place, 0.0))
        pose = pose @ motions[k]
    carriers += [(parent, pose, number) for number in range(body, len(chain.bodies))]
    for element, where, number in carriers:
        x, y, z = weights[number].com
        _add_mass(element, where, float(weights[number].mass), (float(x), float(y), float(z)))
    if len(equality):
        root.append(equality)
    ElementTree.SubElement(parent, "site", {"name": "tcp", **_placed(pose)})
    _fill_empty(root)
    ElementTree.indent(root)
    return ExportedFile(
        ElementTree.tostring(root, encoding="unicode") + "\n", "MJCF", (*play_of_leaders(model), *left_out(model, HELD))
    )


def slot_motions(model: Model) -> list[Array]:
    """(4, 4) each, constant motion along every slot of a model's chain, every joint at zero.

    The middle hinge of a link stands where the link bends.
    """
    axes = (np.eye(3)[slot.axis] for slot in model.chain.slots)
    amounts = map(float, model.chain.driven(every_joint_at_zero(model)))
    parts = _part_of_half_length(model)
    moved = zip(model.chain.slots, axes, amounts, strict=True)
    return [
        turn(axis.tolist(), amount) if slot.rotates else shift(amount * parts.get(slot.key, 1.0) * axis)
        for slot, axis, amount in moved
    ]


def _part_of_half_length(model: Model) -> dict[str, float]:
    """Part of half the link's length that each slot to a hinge shifts by, for a hinge at the point of the bend."""
    points = {
        effect.place: effect.point(values) for effect, values in model.parts() if isinstance(effect, LateralCompliance)
    }
    return {
        slot.key: 2.0 * (point if slot.name.startswith("near_") else 1.0 - point)
        for slot in model.chain.slots
        if slot.to_hinge and (point := points.get(slot.place)) is not None
    }


def spring_stiffness(model: Model) -> dict[int, float]:
    """Stiffness (N·m/rad) of the slots that give way; compliances of one slot add up. A link bends at its middle hinge,
    which stands at the point of the bend (`slot_motions`)."""
    out: dict[int, float] = {}
    for effect, values in model.parts():
        if effect.id in SPRINGS:
            free_values = [value for value, p in zip(values, effect.parameters, strict=True) if p.fixed is None]
            for key, k in zip(effect.targets[: len(free_values)], free_values, strict=True):
                slot = model.chain.index[key]
                out[slot] = out.get(slot, 0.0) + k
    return {slot: 1.0 / k for slot, k in out.items() if k > 0.0}


def _add_servo(
    body: ElementTree.Element, actuators: ElementTree.Element, model: Model, joint: int, axis: str, kp: float, b: float
) -> None:
    drawn = model.arm.joints[joint]
    name, limits = joint_labels(model.arm)[joint], (drawn.lower, drawn.upper)
    ElementTree.SubElement(body, "joint", name=name, axis=axis, damping="0.5", armature="0.01")
    add_play(body, name, b)
    ElementTree.SubElement(actuators, "position", name=name, joint=name, kp=repr(float(kp)), ctrlrange=numbers(limits))


PLAY_ARMATURE, QUICK_S, HARDEST = 0.01, 0.004, 0.9999
"""kg·m², s, and MuJoCo's greatest impedance: with them stops give way by less than 0.1 mrad without chatter, and dry
friction creeps by less than a tenth in ten seconds."""
OF_PLAY = {
    "type": "hinge", "damping": "0.01", "armature": str(PLAY_ARMATURE), "frictionloss": "0", "stiffness": "0",
    "solreflimit": f"{QUICK_S} 1", "solimplimit": f"{HARDEST} {HARDEST} 0.001 0.5 2",
}  # fmt: skip
"""Hard stops, and what a robot's own file may have other defaults for."""


def angle_unit(root: ElementTree.Element) -> float:
    """The unit of angle of an MJCF (rad)."""
    by_degrees = all(compiler.get("angle", "degree") == "degree" for compiler in root.findall("compiler"))
    return float(np.radians(1.0)) if by_degrees else 1.0


def add_play(body: ElementTree.Element, name: str, b: float, unit: float = 1.0) -> None:
    """Gives a joint of a body play, b rad end to end; none where b is 0. `unit`: that of `angle_unit`."""
    if b > 0.0:
        joint = next(element for element in body.findall("joint") if element.get("name") == name)
        placed = {key: value for key in ("class", "axis", "pos") if (value := joint.get(key)) is not None}
        half = numbers((-0.5 * b / unit, 0.5 * b / unit))
        added = ElementTree.Element(
            "joint", {"name": f"{name}_play", **placed, "range": half, "limited": "true", **OF_PLAY}
        )
        body.insert([*body].index(joint) + 1, added)


def _add_follower(
    body: ElementTree.Element,
    equality: ElementTree.Element,
    model: Model,
    slot: Slot,
    mimic: MimicJoint,
    stiffness: float | None,
) -> None:
    """A joint that turns in proportion to another one, and a spring after it, if it gives way itself (N·m/rad)."""
    leader, name, axis = joint_labels(model.arm)[mimic.leader], mimic.link.name or slot.place, np.eye(3)[slot.axis]
    ElementTree.SubElement(body, "joint", name=name, axis=numbers(axis), damping="0.5", armature="0.01")
    if stiffness is not None:
        sprung = {"stiffness": repr(stiffness), "damping": "0.1"}
        ElementTree.SubElement(body, "joint", {"name": slot.key, "axis": numbers(axis), **sprung})
    linear = numbers((mimic.offset, mimic.ratio, 0.0, 0.0, 0.0))
    ElementTree.SubElement(equality, "joint", joint1=name, joint2=leader, polycoef=linear)


def static_play(model: Model) -> dict[str, float]:
    """Play (rad) by place, except of joints that others follow."""
    led = led_places(model.arm)
    return {e.place: values[0] for e, values in model.parts() if e.id == "backlash" and e.place not in led}


def led_places(arm: Arm) -> set[str]:
    """Places of the joints that others follow. They get no play: an equality would follow the servo alone."""
    return {f"joint{mimic.leader + 1}" for mimic in arm.mimics}


def play_of_leaders(model: Model) -> tuple[str, ...]:
    """Play of joints that others follow, which the file lacks."""
    acting = [effect for effect, values in model.parts() if effect.id == "backlash" and values[0] > 0.0]
    return tuple(f"{e.name} ({LED})" for e in acting if e.place in led_places(model.arm))


def _add_mass(element: ElementTree.Element, where: Array, weight: float, com: Sequence[float]) -> None:
    if element.tag == "worldbody" or weight <= 0.0:
        return
    at = where @ np.array([*com, 1.0])
    holder = ElementTree.SubElement(element, "body", pos=numbers(at[:3]))
    moment = numbers([0.4 * weight * BALL**2] * 3)
    ElementTree.SubElement(holder, "inertial", pos="0 0 0", mass=repr(weight), diaginertia=moment)


def _fill_empty(root: ElementTree.Element) -> None:
    """A body that moves needs a mass in MuJoCo: a milligram where the model has none."""
    for body in root.iter("body"):
        if body.find("joint") is not None:
            moment = numbers([1e-9] * 3)
            ElementTree.SubElement(body, "inertial", pos="0 0 0", mass="1e-6", diaginertia=moment)


def _placed(T: Array) -> dict[str, str]:
    return {"pos": numbers(T[:3, 3]), "quat": numbers(quaternions(T[None, :3, :3])[0])}
