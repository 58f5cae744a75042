"""Hard bounds on what a correction may command, whatever the model, its effects and the arm's pose.

A command differs from the wish by the joint's constant zero offset, and by no more than `FARTHEST` beside it. From call
to call this difference changes by no more than `RATE` times the wish, and `CREEP` beside it, or `REVERSAL` where the
joint's error depends on its direction. Both are projections onto boxes that move with the wish: they make no jump of
their own. Where they bite the tool is less accurate, for good or until the next calls have made up for it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lerobot_robot_lrm.correction import Correction
from lrm_math.arrays import Array
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.motion import Motion

FARTHEST = math.radians(15.0)
RATE = 2.0
CREEP, REVERSAL = math.radians(0.2), math.radians(3.0)
"""rad a call; backlash and hysteresis are taken up at once where a joint turns back, as far as the second."""
SAME = 1e-9
"""rad."""


@dataclass(frozen=True, eq=False)
class BoundedCommand:
    """Answer to a wish.

    Attributes:
        wish: (n,), rad, within the limits. command: (n,), rad.
        bounded: (n,), whether a bound changed the command. left: how far from its goal the tip stays by the model (m).
        lost: why the model has no command; "": it has one.
    """

    wish: Array
    command: Array
    bounded: NDArray[np.bool_]
    left: float
    lost: str


def bounded_command(
    correction: Correction, wish: Array, motion: Motion, before: BoundedCommand | None
) -> BoundedCommand:
    """The command for wished angles (n,), rad, that continues a motion, and the answer before if there was one.

    A joint's step is at most (1 + `RATE`) times the largest of the wish, and `CREEP` or `REVERSAL`. Where the model has
    no command, the last correction stays.
    """
    low, high = correction.limits
    at = np.clip(wish, low, high)
    centre = at + correction.zero_shift
    last = None if before is None else before.command - before.wish
    left, lost = 0.0, ""
    try:
        answer = correction.answer(at, motion)
        found, left = answer.command, answer.left
    except NoEquilibrium as error:
        found, lost = (centre if last is None else at + last), str(error)
    command = np.clip(found, centre - FARTHEST, centre + FARTHEST)
    if before is not None and last is not None:
        most = RATE * np.abs(at - before.wish).max() + np.where(correction.slack > 0.0, REVERSAL, CREEP)
        command = at + np.clip(command - at, last - most, last + most)
    command = np.clip(command, low, high)
    bounded = np.abs(command - np.clip(found, low, high)) > SAME
    return BoundedCommand(at, command, bounded, left, lost)
