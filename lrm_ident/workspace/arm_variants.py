"""Variants of an arm: the same arm with a placement, a length or an angle changed, its shapes stretched to match.

Masses stay as they are: a map of what can be reached does not weigh. A real link that is longer is heavier too.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.workspace.voxel_grid import NUMBER
from lrm_math.arm.arm import BASE, TOOL, Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arm.collision_shapes import Capsule, Triple
from lrm_math.arrays import Array
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames

SYNTAX = "say PLACE_NAME_UNIT=VALUE such as base_beta_deg=45, or linkN+20mm, linkN-10mm; several by commas"
VALUE = re.compile(rf"(\w+?)_(\w+)_(mm|deg)=({NUMBER})")
LONGER = re.compile(r"link(\d+)([+-](?:\d+\.?\d*|\.\d+))mm")
PLACEMENT = {"mm": ("x", "y", "z"), "deg": ("alpha", "beta", "gamma")}
JOINT = {"mm": ("d", "a", "extra_z"), "deg": ("theta", "alpha")}
NANOMETRE = 1e-9
MOST = {"mm": 10_000.0, "deg": 360.0}
"""As in arm files."""


@dataclass(frozen=True)
class Variant:
    """An arm and what was changed about it, in words."""

    name: str
    arm: Arm


def variant(arm: Arm, words: str) -> Variant:
    """The arm with changes such as `base_beta_deg=45,link2+20mm`, one after the other.

    Raises:
        UnknownName: a place, or a number of that place, that the arm does not have.
        LrmError: words that say nothing, a value beyond what arm files may hold, a link without one length of its own.
    """
    changed = arm
    parts = [part.strip() for part in words.split(",")]
    for part in parts:
        if longer := LONGER.fullmatch(part):
            changed = lengthened(changed, int(longer[1]), float(longer[2]) * MM)
        elif value := VALUE.fullmatch(part):
            changed = _with_value(changed, value[1], value[2], value[3], float(value[4]))
        else:
            raise LrmError(f"variant '{words}': cannot read '{part}'; {SYNTAX}")
    return Variant(",".join(parts), changed)


def lengthened(arm: Arm, link: int, by: float) -> Arm:
    """Link number `link` (1 to n; the last reaches to the TCP) longer by `by`, or shorter if below zero (m).

    Raises:
        UnknownName: no such link. LrmError: a link with no length, with several, or shorter than nothing.
    """
    if not 1 <= link <= arm.dof:
        raise UnknownName("link", f"link{link}", [f"link{i + 1}" for i in range(arm.dof)])
    lengths = [(f"joint{link}", name, getattr(arm.joints[link - 1], name) or 0.0) for name in JOINT["mm"]]
    if link == arm.dof:
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
    places = [BASE, TOOL, *arm.joint_names]
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
    i = arm.joint_names.index(place)
    joint = replace(arm.joints[i], **{name: value})  # type: ignore[arg-type]
    return replace(arm, joints=(*arm.joints[:i], joint, *arm.joints[i + 1 :]))


def _with_length(arm: Arm, place: str, name: str, value: float) -> Arm:
    """One translation of a link changed, and the capsules along it."""
    changed = _replaced(arm, place, name, value)
    far = arm.dof + 1 if place == TOOL else arm.joint_names.index(place) + 1
    before, after = _home(arm), _home(changed)
    rigid = (far - 1, far) if place == TOOL else (far,)
    capsules = tuple(
        _stretched(capsule, far, before, after) if capsule.frame in rigid else capsule
        for capsule in arm.shapes.capsules
    )
    return replace(changed, shapes=replace(arm.shapes, capsules=capsules))


def _stretched(capsule: Capsule, far: int, before: Array, after: Array) -> Capsule:
    """A capsule whose ends shift with the link's far end, as far along the link from its near end as they stand."""
    shift, way = (b[far, :3, 3] - a for b, a in ((after, before[far, :3, 3]), (before, before[far - 1, :3, 3])))
    along, beyond = float(way @ shift), float(capsule.frame == far)
    old, new = before[capsule.frame], after[capsule.frame]

    has_length = abs(along) > NANOMETRE * float(np.linalg.norm(shift))

    def moved(end: Triple) -> Triple:
        point = old[:3, :3] @ end + old[:3, 3]
        share = np.clip((point - before[far - 1, :3, 3]) @ shift / along, 0.0, 1.0) if has_length else beyond
        x, y, z = (new[:3, :3].T @ (point + share * shift - new[:3, 3])).tolist()
        return (x, y, z)

    return replace(capsule, start=moved(capsule.start), end=moved(capsule.end))


def _home(arm: Arm) -> Array:
    """(n + 2, 4, 4), frames with all joints at zero."""
    chain = chain_of(arm)
    return np.asarray(frames(chain, chain.values([0.0] * arm.dof), 1)[0])
