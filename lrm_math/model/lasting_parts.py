"""What an effect does at a pose, as parts of lasting effects: constant offsets, springs and gains of the same slots."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np

from lrm_math.effects.compliance import SPRINGS
from lrm_math.effects.offsets import Offsets
from lrm_math.effects.servo_errors import ServoGain
from lrm_math.kinematics.chain import Number, Slot
from lrm_math.kinematics.poses import Poses
from lrm_math.model.effect_binding import BoundEffect
from lrm_math.model.model import Model
from lrm_math.model.session_state import CarriedState


def lasting_parts(model: Model, bound: BoundEffect, poses: Poses, state: CarriedState) -> dict[str, float]:
    """Amounts (SI) by key of constant offsets, springs and gains: an effect's at the last of some poses, or on average.

    The response to the load of the pose itself is a spring, on average; what grows with the angle is a gain.
    """
    lasting, unloaded = defaultdict[str, float](float), tuple(0.0 for _ in bound.loads)
    poses = replace(poses, q=np.zeros_like(poses.q))

    def kept(amount: Number) -> float:
        course = np.broadcast_to(np.asarray(amount, dtype=np.float64), len(poses))
        return float(course[-1] if state == "last" else course.mean())

    slots = [model.chain.slots[k] for k in bound.slots]
    for slot, amount in zip(slots, bound.at(poses, unloaded), strict=True):
        lasting[_offset_key(model, slot)] += kept(amount)
    for i, rows in zip(bound.loads, bound.by_loads(poses, unloaded), strict=True):
        for k, slot, response in zip(bound.slots, slots, rows, strict=True):
            if k == model.load_slots[i]:
                lasting[_spring_key(model, slot)] += float(np.mean(response))
    for joint, rows in enumerate(bound.by_angles(poses, unloaded)):
        for slot, gain in zip(slots, rows, strict=True):
            if slot.joint == joint:
                for key in ServoGain(model.arm, slot.place).keys:
                    lasting[key] += kept(gain)
    return {key: amount for key, amount in lasting.items() if key and amount}


def _spring_key(model: Model, slot: Slot) -> str:
    """Key of the linear spring of a slot; empty for a slot that has none."""
    for kind in SPRINGS:
        if slot.place in kind.places(model.arm):
            spring = kind(model.arm, slot.place)
            if slot.key in spring.targets:
                return spring.keys[spring.targets.index(slot.key)]
    return ""


def _offset_key(model: Model, slot: Slot) -> str:
    """Key of the constant offset of a slot; empty for a slot that has none."""
    key = f"{Offsets.id}.{slot.place}.{slot.name}_{'rad' if slot.rotates else 'mm'}"
    there = slot.place in Offsets.places(model.arm) and key in Offsets(model.arm, slot.place).keys
    return key if there else ""
