"""Whether measured angles could contradict an effect's formula: where they could not, its fit shows no cause."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.effects.base import AngleDependentEffect, Excitation
from lrm_math.effects.servo_errors import Coupling, coupled_joints
from lrm_math.kinematics.poses import poses_of

MORE_LEVELS = 2
"""Levels of an angle beyond a formula's parameters: one goes to the joint's offset, one can contradict it."""


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
    left = [q[:, joint]]
    centred = q - q.mean(axis=0)
    for other in range(q.shape[1]):
        if other != joint and (square := float(centred[:, other] @ centred[:, other])) > 0.0:
            slope = float(centred[:, other] @ centred[:, joint]) / square
            left.append(q[:, joint] - slope * q[:, other])
    counts = Excitation(poses_of(np.stack(left, axis=1)), np.zeros((len(q), len(left))))
    return min(counts.levels(column) for column in range(len(left)))


def followed_joint(effect: Effect) -> int | None:
    """Number from 0 of the joint whose angle a formula follows; None for what follows several, or no angle."""
    if isinstance(effect, AngleDependentEffect):
        return effect.joint
    return coupled_joints(effect.place)[1] if isinstance(effect, Coupling) else None
