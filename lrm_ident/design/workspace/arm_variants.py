"""Design variants of an arm: a placement, length or angle changed, and the collision shapes stretched accordingly.

Masses do not change: the capability map is purely kinematic.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.design.workspace.voxel_grid import NUMBER
from lrm_math.arm.arm import BASE, TOOL, Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arm.collision_shapes import Capsule
from lrm_math.arrays import Array, Vector3
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames

SYNTAX = "write PLACE_NAME_UNIT=VALUE such as base_beta_deg=45, or linkN+20mm, linkN-10mm; several by commas"
VALUE = re.compile(rf"(\w+?)_(\w+)_(mm|deg)=({NUMBER})")
LENGTHEN = re.compile(r"link(\d+)([+-](?:\d+\.?\d*|\.\d+))mm")
PLACEMENT = {"mm": ("x", "y", "z"), "deg": ("alpha", "beta", "gamma")}
JOINT = {"mm": ("d", "a", "extra_z"), "deg": ("theta", "alpha")}
NANOMETRE = 1e-9
MOST = {"mm": 10_000.0, "deg": 360.0}  # as in arm files


@dataclass(frozen=True)
class ArmVariant:
    """An arm and its changes in the syntax of the command line."""

    name: str
    arm: Arm


def parse_variant(arm: Arm, words: str) -> ArmVariant:
    """The arm with changes such as `base_beta_deg=45,link2+20mm`, applied in order.

    Raises:
        UnknownName: a place or dimension that the arm does not have.
        LrmError: a syntax error, a value outside the range of arm files, a link without a single length.
    """
    changed = arm
    parts = [part.strip() for part in words.split(",")]
    for part in parts:
        if longer := LENGTHEN.fullmatch(part):
            changed = lengthened(changed, int(longer[1]), float(longer[2]) * MM)
        elif value := VALUE.fullmatch(part):
            changed = _with_value(changed, value[1], value[2], value[3], float(value[4]))
        else:
            raise LrmError(f"variant '{words}': cannot read '{part}'; {SYNTAX}")
    return ArmVariant(",".join(parts), changed)


def lengthened(arm: Arm, link: int, by: float) -> Arm:
    """The arm with link 1 to n (the last ends at the TCP) longer by `by` (m), which may be negative.

    Raises `UnknownName` for no such link; `LrmError` for a link without a single length, or a length not above zero.
    """
    if not 1 <= link <= len(arm.links):
        raise UnknownName("link", f"link{link}", [f"link{i + 1}" for i in range(len(arm.links))])
    drawn, own_place = arm.links[link - 1], arm.link_places[link - 1]
    lengths = [(own_place, name, getattr(drawn, name) or 0.0) for name in JOINT["mm"]]
    if link == len(arm.links):
        lengths += [(TOOL, name, getattr(arm.tool, name)) for name in PLACEMENT["mm"]]
    real = [part for part in lengths if abs(part[2]) > NANOMETRE]
    if len(real) != 1:
        listed = ", ".join(f"{place}_{name}_mm={length * 1e3:g}" for place, name, length in real or lengths)
        raise LrmError(f"link{link} of arm '{arm.name}' has no single length; set one of {listed}")
    place, name, length = real[0]
    if abs(length) + by <= 0.0:
        raise LrmError(f"link{link} of arm '{arm.name}' is {abs(length) * 1e3:g} mm long; cannot be {-by * 1e3:g} less")
    return _with_length(arm, place, name, math.copysign(abs(length) + by, length))


def _with_value(arm: Arm, place: str, name: str, unit: str, value: float) -> Arm:
    places = [BASE, TOOL, *arm.link_places]
    if place not in places:
        raise UnknownName("place in a variant", place, places)
    valid = (PLACEMENT if place in (BASE, TOOL) else JOINT)[unit]
    if name not in valid:
        raise UnknownName(f"number of {place} in {unit}", name, valid)
    if abs(value) > MOST[unit]:
        raise LrmError(f"variant: {place}_{name}_{unit}={value:g}; at most {MOST[unit]:g} {unit} either way")
    if unit == "mm" and place != BASE:
        return _with_length(arm, place, name, value * MM)
    return _replaced(arm, place, name, value * MM if unit == "mm" else float(np.radians(value)))


def _replaced(arm: Arm, place: str, name: str, value: float) -> Arm:
    if place in (BASE, TOOL):
        return replace(arm, **{place: replace(getattr(arm, place), **{name: value})})
    if place not in arm.joint_names:
        k = int(place.removeprefix("mimic")) - 1
        link = replace(arm.mimics[k].link, **{name: value})  # type: ignore[arg-type]
        return replace(arm, mimics=(*arm.mimics[:k], replace(arm.mimics[k], link=link), *arm.mimics[k + 1 :]))
    i = arm.joint_names.index(place)
    joint = replace(arm.joints[i], **{name: value})  # type: ignore[arg-type]
    return replace(arm, joints=(*arm.joints[:i], joint, *arm.joints[i + 1 :]))


def _with_length(arm: Arm, place: str, name: str, value: float) -> Arm:
    """The arm with one translation of a link changed, and the capsules along it stretched."""
    changed = _replaced(arm, place, name, value)
    distal = arm.frame_names.index(place)
    before, after = _home(arm), _home(changed)
    rigid = (distal - 1, distal) if place == TOOL else (distal,)
    capsules = tuple(
        _stretched(capsule, distal, before, after) if capsule.frame in rigid else capsule
        for capsule in arm.shapes.capsules
    )
    return replace(changed, shapes=replace(arm.shapes, capsules=capsules))


def _stretched(capsule: Capsule, distal: int, before: Array, after: Array) -> Capsule:
    """A capsule whose ends shift with the link's distal end, in proportion to their distance from its proximal end."""
    near = before[distal - 1, :3, 3]
    shift = after[distal, :3, 3] - before[distal, :3, 3]
    along, beyond = float((before[distal, :3, 3] - near) @ shift), float(capsule.frame == distal)
    old, new = before[capsule.frame], after[capsule.frame]
    has_length = abs(along) > NANOMETRE * float(np.linalg.norm(shift))

    def moved(end: Vector3) -> Vector3:
        """An end of the capsule in its new frame (m)."""
        point = old[:3, :3] @ end + old[:3, 3]
        share = np.clip((point - near) @ shift / along, 0.0, 1.0) if has_length else beyond
        x, y, z = (new[:3, :3].T @ (point + share * shift - new[:3, 3])).tolist()
        return (x, y, z)

    return replace(capsule, start=moved(capsule.start), end=moved(capsule.end))


def _home(arm: Arm) -> Array:
    """(n + 2, 4, 4), frames with all joints at zero."""
    chain = chain_of(arm)
    return np.asarray(frames(chain, chain.values([0.0] * arm.dof), 1)[0])
