"""Joints of a robot file with the dynamics that were identified: damping, armature and dry friction in N·m.

Command and encoder alone show frequencies and angles. The servo's stiffness K (N·m/rad) makes torques of them; gravity
shows it where the servo yields to it (`gravity_sag`, or `compliance` of a model of poses). Then with J = K/ω²:
armature J − M, with M the links' inertia, which the file's bodies have; damping 2ζωJ; friction c K.
Play that is crossed in motion needs no stiffness; an MJCF holds it as it holds the play of a model of poses.
Isaac Lab's `ImplicitActuatorCfg` takes the same by its own names, in a file that holds nothing else.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from lrm_ident.data.robot_files.mjcf import HARDEST, LED, add_play, angle_unit, led_places, spring_stiffness
from lrm_ident.data.robot_files.urdf import numbers
from lrm_ident.data.robot_files.urdf_export import ExportedFile
from lrm_ident.data.wording import joint_labels
from lrm_math.effects.reference import EffectRef
from lrm_math.errors import FileError
from lrm_math.model.model import Model
from lrm_math.motion.effects import CoulombFriction, GravitySag, MotionPlay, RestOffset, ServoResponse
from lrm_math.motion.loads import reference_inertia
from lrm_math.motion.motion_model import MotionModel

WRITTEN = (ServoResponse.id, GravitySag.id, CoulombFriction.id, RestOffset.id)
"""Effects of motion that a joint of a file holds, and those that are no dynamics."""
ISAAC = "Isaac Lab actuators (fields of ImplicitActuatorCfg)"


@dataclass(frozen=True)
class JointDynamics:
    """Dynamics of a joint: stiffness of its servo (N·m/rad), damping (N·m·s/rad), armature (kg m²), friction (N·m)."""

    stiffness: float
    damping: float
    armature: float
    friction: float


def joint_dynamics(motion: MotionModel, poses: Model) -> tuple[dict[str, JointDynamics], tuple[str, ...]]:
    """Dynamics by the joint's name, and what no file holds. `poses`: the static model, which may know stiffness."""
    links = reference_inertia(motion.arm)
    springs = spring_stiffness(poses)
    dynamics: dict[str, JointDynamics] = {}
    left_out = [effect.name for effect in motion.added if effect.id not in WRITTEN]
    for joint, label in enumerate(joint_labels(motion.arm)):
        place = motion.arm.joint_names[joint]
        sag = motion.values.get(f"{GravitySag.id}.{place}.k_rad_per_Nm", 0.0)
        stiffness = 1.0 / sag if sag > 0.0 else springs.get(poses.chain.joint_slots[joint])
        if stiffness is None:
            left_out.append(
                f"dynamics of {label} (neither gravity_sag@{place} nor compliance: its stiffness is unknown)"
            )
            continue
        omega = 2.0 * np.pi * motion.values[f"{ServoResponse.id}.{place}.frequency_Hz"]
        ratio = motion.values[f"{ServoResponse.id}.{place}.damping_ratio"]
        inertia = stiffness / omega**2
        rubs = stiffness * motion.values.get(f"{CoulombFriction.id}.{place}.c_rad", 0.0)
        armature = max(inertia - float(links[joint]), 0.0)
        dynamics[label] = JointDynamics(stiffness, 2.0 * ratio * omega * inertia, armature, rubs)
    return dynamics, tuple(left_out)


def with_dynamics(file: ExportedFile, path: Path, motion: MotionModel, poses: Model) -> ExportedFile:
    """An exported URDF or MJCF whose joints have the identified dynamics, or Isaac Lab's actuators of these.

    Raises `FileError`: another arm or file, or no joint with known dynamics for Isaac Lab.
    """
    if motion.arm != poses.arm:
        raise FileError(path, "--motion", f"is a model of {motion.arm.name}", f"one of {poses.arm.name}")
    dynamics, left_out = joint_dynamics(motion, poses)
    if file.what == ISAAC:
        if not dynamics:
            source = "gravity_sag in the motion model, or compliance in the model of poses"
            raise FileError(path, "--motion", "no joint's stiffness is known, so there are no torques", source)
        return ExportedFile(_isaac_text(dynamics), file.what, (*file.left_out, *left_out), file.advice)
    if path.suffix not in (".xml", ".mjcf", ".urdf"):
        raise FileError(path, "--motion", f"a {path.suffix} holds no dynamics", ".xml (MJCF) or .urdf")
    root = ElementTree.fromstring(file.text)
    if root.tag == "robot":
        changed = _in_urdf(root, dynamics)
    else:
        changed = _in_mjcf(root, dynamics)
        held = _play_in_mjcf(root, motion)
        led = {str(EffectRef(MotionPlay.id, place)) for place in led_places(motion.arm)}
        left_out = tuple(f"{name} ({LED})" if name in led else name for name in left_out if name not in held)
    missing = tuple(f"dynamics of {name} (no joint of that name)" for name in dynamics if name not in set(changed))
    text = ElementTree.tostring(root, encoding="unicode") + "\n"
    return ExportedFile(text, file.what, (*file.left_out, *left_out, *missing), file.advice)


def _isaac_text(dynamics: Mapping[str, JointDynamics]) -> str:
    """JSON with the fields of Isaac Lab's `ImplicitActuatorCfg`, by joint: N·m/rad, N·m·s/rad, kg m² and N·m.

    The damping is that of the drive, so no viscous friction is left. Dry friction has one value, at rest and in motion.
    """
    same = {field: field for field in ("stiffness", "damping", "armature", "friction")} | {
        "dynamic_friction": "friction"
    }
    tables = {
        field: {name: float(getattr(joint_values, attribute)) for name, joint_values in dynamics.items()}
        for field, attribute in same.items()
    }
    tables["viscous_friction"] = dict.fromkeys(dynamics, 0.0)
    return json.dumps({"joint_names_expr": [*dynamics], **tables}, indent=1) + "\n"


def _in_urdf(root: ElementTree.Element, dynamics: Mapping[str, JointDynamics]) -> Sequence[str]:
    changed = []
    for joint in root.findall("joint"):
        joint_values = dynamics.get(joint.get("name", ""))
        if joint_values is None:
            continue
        for old in joint.findall("dynamics"):
            joint.remove(old)
        ElementTree.SubElement(
            joint, "dynamics", damping=numbers([joint_values.damping]), friction=numbers([joint_values.friction])
        )
        changed.append(joint.get("name", ""))
    return changed


def _in_mjcf(root: ElementTree.Element, dynamics: Mapping[str, JointDynamics]) -> Sequence[str]:
    changed = []
    braked = {actuator.get("joint", ""): _set_servo(actuator, dynamics) for actuator in _servos(root, dynamics)}
    for joint in root.iter("joint"):
        joint_values = dynamics.get(joint.get("name", ""))
        if joint_values is None:
            continue
        damping = max(joint_values.damping - braked.get(joint.get("name", ""), 0.0), 0.0)
        joint.set("damping", numbers([damping]))
        joint.set("armature", numbers([joint_values.armature]))
        joint.set("frictionloss", numbers([joint_values.friction]))
        if joint_values.friction > 0.0:
            joint.set("solimpfriction", numbers([HARDEST, HARDEST]))
        changed.append(joint.get("name", ""))
    return changed


def _play_in_mjcf(root: ElementTree.Element, motion: MotionModel) -> Sequence[str]:
    """Adds what joints have in motion, except where it is there already or others follow; names of what is held."""
    labels, led, held = joint_labels(motion.arm), led_places(motion.arm), []
    bodies = {joint.get("name", ""): body for body in root.iter("body") for joint in body.findall("joint")}
    for effect in motion.added:
        name = labels[effect.joint]
        if isinstance(effect, MotionPlay) and name in bodies and effect.place not in led:
            if f"{name}_play" not in bodies:
                add_play(bodies[name], name, motion.values[effect.keys[0]], angle_unit(root))
            held.append(effect.name)
    return held


def _servos(root: ElementTree.Element, dynamics: Mapping[str, JointDynamics]) -> Iterator[ElementTree.Element]:
    for group in root.findall("actuator"):
        yield from (
            actuator
            for actuator in group
            if actuator.get("joint") in dynamics and actuator.tag in ("position", "general")
        )


def _set_servo(actuator: ElementTree.Element, dynamics: Mapping[str, JointDynamics]) -> float:
    """Gives a position actuator its stiffness; the damping (N·m·s/rad) that it has itself."""
    stiffness = dynamics[actuator.get("joint", "")].stiffness
    if actuator.tag == "position":
        actuator.set("kp", repr(float(stiffness)))
        return float(actuator.get("kv", "0"))
    bias = [*map(float, actuator.get("biasprm", "0 0 0").split()), 0.0, 0.0][:3]
    gain = actuator.get("gainprm", "1").split()
    actuator.set("gainprm", " ".join([repr(float(stiffness)), *gain[1:]]))
    actuator.set("biasprm", numbers([bias[0], -stiffness, bias[2]]))
    return -bias[2]
