"""Why an effect that predicts better shows no cause: its formula is free, measured angles could not contradict it, or
it explains too little."""

from __future__ import annotations

from collections.abc import Collection
from enum import StrEnum

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects import Effect, variants
from lrm_math.effects.base import AngleDependentEffect, Excitation
from lrm_math.effects.servo_errors import Coupling, coupled_joints
from lrm_math.kinematics.poses import poses_of

MORE_LEVELS = 2
"""Levels of an angle beyond a formula's parameters: one goes to the joint's offset, one can contradict it."""


class NoCause(StrEnum):
    """Why an effect that predicts better shows no cause."""

    OTHER_FORM = "other_form"
    """It is another form of effects that the model has."""
    FREE_FORM = "free_form"
    """It may stand for any of several effects (`variants`)."""
    FEW_ANGLES = "few_angles"
    """The measured angles could not contradict its formula."""
    LITTLE = "little"
    """It explains too little."""


def why_no_cause(effect: Effect, q: Array, present: Collection[str] = ()) -> NoCause:
    """Reason why an effect that predicts better shows no cause, if it shows none; without another it is `LITTLE`.

    Args:
        q: (N, n), measured commands (rad). present: effects (`effect@place`) of the model.
    """
    if effect.is_free_form:
        return NoCause.FREE_FORM if set(variants(effect)).isdisjoint(present) else NoCause.OTHER_FORM
    return NoCause.LITTLE if can_be_contradicted(effect, q) else NoCause.FEW_ANGLES


def can_be_contradicted(effect: Effect, q: Array) -> bool:
    """Whether commands q (N, n), rad, could contradict the formula of an effect that follows the angle of one joint.

    Any function of the angle fits as well where the joint stood at no more levels than the offset and the effect's
    parameters; and a function of another joint's angle, where the two joints moved together. Other effects: always.
    """
    joint = followed_joint(effect)
    if joint is None:
        return True
    fitted = sum(parameter.fixed is None for parameter in effect.parameters)
    return levels_of_its_own(q, joint) >= fitted + MORE_LEVELS


def levels_of_its_own(q: Array, joint: int) -> int:
    """Number of levels (to 0.5°) of a joint from 0 at commands q (N, n), rad, that no other joint's angle explains.

    By least squares, a line of one other joint's angle at a time; that of a joint that never moves explains none.
    """
    levels = [q[:, joint]]
    centred = q - q.mean(axis=0)
    for other in range(q.shape[1]):
        if other != joint and (square := float(centred[:, other] @ centred[:, other])) > 0.0:
            slope = float(centred[:, other] @ centred[:, joint]) / square
            levels.append(q[:, joint] - slope * q[:, other])
    counts = Excitation(poses_of(np.stack(levels, axis=1)), np.zeros((len(q), len(levels))))
    return min(counts.levels(column) for column in range(len(levels)))


def followed_joint(effect: Effect) -> int | None:
    """Number from 0 of the joint whose angle a formula follows; None for what follows several, or no angle."""
    if isinstance(effect, AngleDependentEffect):
        return effect.joint
    return coupled_joints(effect.place)[1] if isinstance(effect, Coupling) else None
