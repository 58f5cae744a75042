"""The effects that the kernel has a formula for, by class; the rest is computed in Python (`model.joint_errors`).

Springs and axial play act on any slot, the laws here on joints alone; a test compares each law with its effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from lrm_math.effects.backlash import AxialPlay, Backlash, Hysteresis
from lrm_math.effects.base import Effect
from lrm_math.effects.compliance import NonlinearStiffness, Spring
from lrm_math.effects.field.residual_field import JOINTS_TOGETHER, WAVES_ALONE, ResidualField
from lrm_math.effects.forces import CableSpring
from lrm_math.effects.servo_errors import (
    CommonGain,
    Coupling,
    Eccentricity,
    ServoGain,
    TransmissionRipple,
    coupled_joints,
)
from lrm_math.effects.targets import Kind
from lrm_math.ik.kernel.shared_library import MAX_TERMS, fits
from lrm_math.model.effect_binding import BoundEffect, EffectBinding
from lrm_math.model.model import Model

KernelLaw: TypeAlias = tuple[int, int, tuple[float, ...]]
"""Number of the law, joint from 0, parameters (SI, at most four)."""

EVERYWHERE = (-1e9, 1e9)
"""N·m: the range of a law whose range is not known."""
ON_ANY_SLOT = (Spring, AxialPlay, ResidualField)
KERNEL_LAWS: dict[type[Effect], int] = {
    ServoGain: 0,
    CommonGain: 0,
    Eccentricity: 1,
    Backlash: 2,
    NonlinearStiffness: 3,
    Hysteresis: 4,
    CableSpring: 5,
    Coupling: 6,
    TransmissionRipple: 7,
}


def acting(binding: EffectBinding) -> tuple[BoundEffect, ...]:
    """The effects that move or load slots and are not constant."""
    return (*binding.rigid, *binding.elastic, *binding.loading)


def without_formula(model: Model) -> tuple[BoundEffect, ...]:
    """The effects that the kernel has no formula for; in it a load that an effect puts on a joint acts on joints."""
    load_slots, joint_slots = model.load_slots, {*model.chain.joint_slots}
    elsewhere = {load_slots[i] for b in model.binding.elastic if not {*b.slots} <= joint_slots for i in b.loads}

    def known(bound: BoundEffect) -> bool:
        alone = bound.kind is Kind.MOTION or elsewhere.isdisjoint(bound.slots)
        is_law = type(bound.effect) in KERNEL_LAWS and {*bound.slots} <= joint_slots and alone
        return is_law or isinstance(bound.effect, ON_ANY_SLOT)

    return tuple(bound for bound in acting(model.binding) if not known(bound))


def kernel_laws(model: Model) -> tuple[KernelLaw, ...]:
    """The laws of a model's joints, of effects that the kernel has a formula for."""
    unknown, joint_slots = {id(bound) for bound in without_formula(model)}, model.chain.joint_slots
    laws = [b for b in acting(model.binding) if type(b.effect) in KERNEL_LAWS and id(b) not in unknown]
    return tuple(
        (KERNEL_LAWS[type(b.effect)], joint_slots.index(slot), _parameters(b)) for b in laws for slot in b.slots
    )


def kernel_field(model: Model, row: Mapping[int, int]) -> dict[str, ArrayLike]:
    """Fields of the kernel's arm for a model's residual field, none without one; `row`: place of each moving slot.

    Each term has an axis, from 1, the numbers of its three factors, 0 for a one, m + `WAVES_ALONE` j for the cosine of
    m half waves of joint j, at most `field_waves`, and a coefficient (m). `field_axis`: along which a slot moves. Range
    of the commands: rad. `field_base`: nine numbers, the base's axes x, y and z.
    """
    for bound in model.binding.rigid:
        if isinstance(bound.effect, ResidualField):
            field, along = bound.effect.over(bound.within), np.zeros(len(row), dtype=np.int32)
            along[[row[k] for k in bound.slots]] = 1, 2, 3
            terms, (lower, upper) = tuple(field.terms(bound.p)), zip(*field.ends, strict=True)
            fits("terms of the residual field", len(terms), MAX_TERMS)
            return {
                "terms": len(terms), "term": [value for _, _, value in terms], "field_axis": along,
                "term_axis": [1 + axis for axis, _, _ in terms], "field_lower": lower, "field_upper": upper,
                "term_factor": [_factors(waves) for _, waves, _ in terms], "field_base": field.base.T.ravel(),
                "field_turn": 0.0, "field_waves": max((max(waves) for _, waves, _ in terms), default=0),
            }  # fmt: skip
    return {}


def _factors(waves: Sequence[int]) -> tuple[int, ...]:
    factors = [WAVES_ALONE * joint + wave for joint, wave in enumerate(waves) if wave]
    return (*factors, *[0] * (JOINTS_TOGETHER - len(factors)))


def _parameters(bound: BoundEffect) -> tuple[float, ...]:
    """Parameters of a law: those of the effect; of a gain of all joints that of both sides, of a coupling also the
    number of the joint that turns the other, of a law of the torque that is held beyond its range the range's ends."""
    if isinstance(bound.effect, NonlinearStiffness):
        load_within = {} if bound.within is None else bound.within.load
        return (*bound.p, *load_within.get(bound.effect.targets[0], EVERYWHERE))
    if isinstance(bound.effect, CommonGain):
        return bound.p * 2
    if isinstance(bound.effect, Coupling):
        return (*bound.p, float(coupled_joints(bound.effect.place)[1]))
    return bound.p
