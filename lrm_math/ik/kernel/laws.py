"""The joint laws that the kernel knows: effects of the catalogue that only change joint angles, by class.

A law of another class is computed in Python (`joint_errors.JointErrorModel`); a test compares each with its effect.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

from lrm_math.effects.backlash import AxialPlay, Backlash, Hysteresis
from lrm_math.effects.base import Effect
from lrm_math.effects.compliance import NonlinearStiffness
from lrm_math.effects.forces import CableSpring
from lrm_math.effects.servo_errors import Eccentricity, ServoGain
from lrm_math.model.effect_binding import BoundEffect, EffectBinding

KernelLaw: TypeAlias = tuple[int, int, tuple[float, ...]]
"""Number of the law, joint from 0, parameters (SI, at most four)."""

KERNEL_LAWS: dict[type[Effect], int] = {
    ServoGain: 0,
    Eccentricity: 1,
    Backlash: 2,
    NonlinearStiffness: 3,
    Hysteresis: 4,
    CableSpring: 5,
}
COUPLING = 6
"""A motion in proportion to another joint's command; parameters: ratio, number of that joint from 0."""


def nonlinear_effects(binding: EffectBinding) -> list[BoundEffect]:
    """Effects other than springs and axial play, which move any slot in the kernel."""
    return [*binding.rigid, *(b for b in binding.elastic if not (b.effect.linear or isinstance(b.effect, AxialPlay)))]


def kernel_laws(binding: EffectBinding, joint_of: dict[int, int]) -> tuple[KernelLaw, ...] | None:
    """The laws of a model, `joint_of`: slots of the chain to joints from 0. None if the kernel lacks one of them."""
    nonlinear = nonlinear_effects(binding)
    acting = {id(bound): bound for bound in (*nonlinear, *binding.pushing)}.values()
    on_joints = all(k in joint_of for bound in acting for k in (*bound.moves, *bound.pushes))
    if not on_joints or any(type(bound.effect) not in KERNEL_LAWS for bound in acting):
        return None
    if any(k not in joint_of for k, _, _ in binding.gears):
        return None
    laws = [(KERNEL_LAWS[type(bound.effect)], joint_of[(*bound.moves, *bound.pushes)[0]], bound.p) for bound in acting]
    return (*laws, *_couplings(binding, joint_of))


def _couplings(binding: EffectBinding, joint_of: dict[int, int]) -> Iterator[KernelLaw]:
    for k, joint, ratio in binding.gears:
        yield COUPLING, joint_of[k], (ratio, float(joint))
