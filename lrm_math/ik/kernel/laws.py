"""The effects that the kernel has a formula for, by class; the rest is computed in Python (`model.joint_errors`).

Springs and axial play act on any slot, the laws here on joints alone; a test compares each law with its effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from lrm_math.effects.backlash import AxialPlay, Backlash, Hysteresis
from lrm_math.effects.base import Effect
from lrm_math.effects.compliance import NonlinearStiffness, Spring
from lrm_math.effects.field.residual_field import JOINTS_TOGETHER, WAVES_ALONE, ResidualField
from lrm_math.effects.forces import CableSpring
from lrm_math.effects.servo_errors import CommonGain, Coupling, Eccentricity, ServoGain, coupled_joints
from lrm_math.effects.targets import Kind
from lrm_math.model.effect_binding import BoundEffect, EffectBinding

KernelLaw: TypeAlias = tuple[int, int, tuple[float, ...]]
"""Number of the law, joint from 0, parameters (SI, at most four)."""

EVERYWHERE = (-1e9, 1e9)
"""N·m: the range of a law whose range is not known."""
KERNEL_LAWS: dict[type[Effect], int] = {
    ServoGain: 0,
    CommonGain: 0,
    Eccentricity: 1,
    Backlash: 2,
    NonlinearStiffness: 3,
    Hysteresis: 4,
    CableSpring: 5,
    Coupling: 6,
}


def acting(binding: EffectBinding) -> tuple[BoundEffect, ...]:
    """The effects that move or load slots and are not constant."""
    return (*binding.rigid, *binding.elastic, *binding.loading)


def without_formula(
    binding: EffectBinding, load_slots: Sequence[int], joint_slots: Sequence[int]
) -> tuple[BoundEffect, ...]:
    """The effects that the kernel has no formula for; `load_slots`, `joint_slots`: numbers of the chain's slots.

    In the kernel a load that an effect puts on a joint acts on joints alone.
    """
    fields = (bound for bound in binding.rigid if isinstance(bound.effect, ResidualField))
    known = {id(bound) for bound in (*binding.of_class(Spring), *binding.of_class(AxialPlay), *fields)}
    elsewhere = {load_slots[i] for b in binding.elastic if not {*b.slots} <= {*joint_slots} for i in b.loads}
    for bound in acting(binding):
        alone = bound.kind is Kind.MOTION or elsewhere.isdisjoint(bound.slots)
        if type(bound.effect) in KERNEL_LAWS and {*bound.slots} <= {*joint_slots} and alone:
            known.add(id(bound))
    return tuple(bound for bound in acting(binding) if id(bound) not in known)


def kernel_laws(binding: EffectBinding, joint_slots: Sequence[int]) -> tuple[KernelLaw, ...]:
    """The laws of a model's joints, of effects that the kernel has a formula for; `joint_slots`: of the chain."""
    laws = [bound for bound in acting(binding) if type(bound.effect) in KERNEL_LAWS]
    return tuple(
        (KERNEL_LAWS[type(b.effect)], joint_slots.index(slot), _parameters(b)) for b in laws for slot in b.slots
    )


class KernelField(NamedTuple):
    """A residual field: of each of T terms the axis, the numbers of its three factors and the coefficient (m).

    A factor is 0, a one, or m + `WAVES_ALONE` j, the cosine of m half waves of joint j, at most `waves`. `slots`: of
    the chain that it moves along x, y and z. `lower`, `upper`: range of the joints' commands (rad). `base`: nine
    numbers, row by row, the base's axes as columns.
    """

    axes: tuple[int, ...]
    factors: tuple[tuple[int, ...], ...]
    coefficients: tuple[float, ...]
    slots: tuple[int, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    base: tuple[float, ...]
    waves: int


def kernel_field(binding: EffectBinding) -> KernelField | None:
    """The residual field of a model as the kernel computes it; None without one."""
    bound = next((bound for bound in binding.rigid if isinstance(bound.effect, ResidualField)), None)
    if bound is None or not isinstance(bound.effect, ResidualField):
        return None
    field = bound.effect.over(bound.within)
    terms = tuple(field.terms(bound.p))
    factors = tuple(_factors(waves) for _, waves, _ in terms)
    lower, upper = zip(*field.ends, strict=True)
    axes, coefficients = tuple(axis for axis, _, _ in terms), tuple(value for _, _, value in terms)
    base, most = tuple(field.base.ravel().tolist()), max((max(waves) for _, waves, _ in terms), default=0)
    return KernelField(axes, factors, coefficients, bound.slots, tuple(lower), tuple(upper), base, most)


def _factors(waves: Sequence[int]) -> tuple[int, ...]:
    factors = [WAVES_ALONE * joint + wave for joint, wave in enumerate(waves) if wave]
    return (*factors, *[0] * (JOINTS_TOGETHER - len(factors)))


def _parameters(bound: BoundEffect) -> tuple[float, ...]:
    """Parameters of a law: those of the effect; of a gain of all joints that of both sides, of a coupling also the
    number of the joint that turns the other, of a law of the torque that is held beyond its range the range's ends."""
    if isinstance(bound.effect, NonlinearStiffness):
        known = {} if bound.within is None else bound.within.load
        return (*bound.p, *known.get(bound.effect.targets[0], EVERYWHERE))
    if isinstance(bound.effect, CommonGain):
        return bound.p * 2
    if isinstance(bound.effect, Coupling):
        return (*bound.p, float(coupled_joints(bound.effect.place)[1]))
    return bound.p
