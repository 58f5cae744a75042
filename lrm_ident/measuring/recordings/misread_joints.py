"""Joints whose command and encoder are no numbers of the same angle: tried before any cause of a difference.

A full turn between them (the encoder's seam), a reversed sign, another unit, an encoder that stands still, joints that
are swapped, rests beyond the limits of the arm's file. What fits is named, and the angles are read so from there on.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from lrm_ident.data.registration.zero_conventions import BEYOND, FULL_TURN
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array

Mistake = Literal["full turn", "reversed", "unit", "frozen", "swapped", "limits"]
MISTAKES: tuple[Mistake, ...] = get_args(Mistake)
MISSED = float(np.radians(1.0))
"""rad RMS between command and encoder below which nothing was misread."""
FEWEST_STILL = 4
"""Rests at which an encoder that followed before has to stand still."""
PART = 0.2
"""What another reading leaves of that at most: a servo that yields follows its command, a misread one does not."""
STILL, MOVING = float(np.radians(1.0)), float(np.radians(3.0))
"""rad, standard deviations over the rests: of an encoder that stands still, while it is commanded to move."""
COUNT = FULL_TURN / 4096
DEG = float(np.radians(1.0))
UNITS = {"radians": 1.0 / DEG, "counts of an encoder": COUNT / DEG}
"""By how much numbers that were taken for degrees are larger."""


@dataclass(frozen=True)
class Misreading:
    """A mistake at one joint.

    Attributes:
        joint: from 0. size: rad, by which command and encoder differed at most; of limits, how far beyond.
        rests: at how many. other: the joint whose angles its encoder reads, of swapped ones. what: of a unit, in words.
    """

    joint: int
    mistake: Mistake
    size: float
    rests: int
    other: int | None = None
    what: str = ""


def read_alike(command: Array, state: Array) -> tuple[Array, Array, tuple[Misreading, ...]]:
    """Command and state (R, n), rad, at R rests as they agree best, and what was mistaken where they did not."""
    command, state, misreadings = command.copy(), state.copy(), list[Misreading]()
    for joint in range(command.shape[1]):
        misread = _alone(joint, command[:, joint], state[:, joint])
        if misread is not None:
            mistake, command[:, joint], state[:, joint] = misread
            misreadings.append(mistake)
    exchanged = list(_exchanged(command, state))
    columns = [misread.joint for misread in exchanged]
    state[:, columns] = state[:, [misread.other for misread in exchanged if misread.other is not None]]
    return command, state, (*misreadings, *exchanged)


def _alone(joint: int, command: Array, state: Array) -> tuple[Misreading, Array, Array] | None:
    """The mistake that explains most of one joint's difference, and its angles (R,) without it."""
    error = state - command
    largest, count = float(np.abs(error).max()), len(error)
    turns = np.round(error / FULL_TURN)
    if turns.any() and _rms(error - FULL_TURN * turns) < PART * _rms(error):
        turned = Misreading(joint, "full turn", largest, int(np.count_nonzero(turns)))
        return turned, command, state - FULL_TURN * turns
    missed = float(error.std())
    if missed < MISSED:
        return None
    if np.std(state + command) < PART * missed:
        return Misreading(joint, "reversed", largest, count), -command, state
    still = bool(np.std(state) < STILL and np.std(command) > MOVING)
    residual, what, command_so, state_so = min(_other_units(command, state, still), key=lambda reading: reading[0])
    if residual < PART * missed:
        return Misreading(joint, "unit", largest, count, what=what), command_so, state_so
    stuck = 0 if still else _still_from(command, state)
    if stuck is None:
        return None
    return Misreading(joint, "frozen", largest, count - stuck), command, np.append(state[:stuck], command[stuck:])


def _still_from(command: Array, state: Array) -> int | None:
    """Number of the rest from which an encoder stands still to the end, if it followed its command (R,) before."""
    for rest in range(1, len(state) - FEWEST_STILL + 1):
        if np.std(state[rest:]) < STILL:
            error, moves = (state - command), np.std(command[rest:]) > MOVING
            return rest if moves and np.std(error[:rest]) < PART * error.std() else None
    return None


def _other_units(command: Array, state: Array, still: bool) -> Iterator[tuple[float, str, Array, Array]]:
    """Angles (R,) in other units: the deviation that each leaves, words, command and state; `still`: none moves."""
    for unit, factor in UNITS.items():
        zero = -0.5 * FULL_TURN if unit.startswith("counts") else 0.0
        read, sent = factor * state + zero, factor * command + zero
        yield float(np.std(read - command)), f"its encoder's angles look like {unit}", command, read
        if not still:
            yield float(np.std(state - sent)), f"its commands look like {unit}", sent, state


def _exchanged(command: Array, state: Array) -> Iterator[Misreading]:
    """Joints whose encoder reads another one's angle, all of them in a circle."""
    error = state - command
    apart = [joint for joint in range(error.shape[1]) if error[:, joint].std() >= MISSED]
    fits = {
        joint: [other for other in apart if np.std(state[:, other] - command[:, joint]) < PART * error[:, joint].std()]
        for joint in apart
    }
    reads = {joint: others[0] for joint, others in fits.items() if len(others) == 1}
    if {*reads} == {*reads.values()}:
        for joint, other in reads.items():
            yield Misreading(joint, "swapped", float(np.abs(error[:, joint]).max()), len(error), other)


def within_limits(arm: Arm, command: Array, state: Array) -> tuple[Array, Array, tuple[Misreading, ...]]:
    """Angles (R, n) with those a full turn beyond the limits turned back, and the joints that stand beyond theirs."""
    low, high = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    turn = np.sign(state) * FULL_TURN
    outside = (state < low - BEYOND) | (state > high + BEYOND)
    turned = outside & (state - turn >= low - BEYOND) & (state - turn <= high + BEYOND)
    misreadings = []
    for joint in range(arm.dof):
        back, gone = turned[:, joint], (outside & ~turned)[:, joint]
        if back.any():
            misreadings.append(
                Misreading(joint, "full turn", FULL_TURN, int(back.sum()), what="command and encoder both")
            )
        if gone.any():
            past = np.maximum(low[joint] - state[:, joint], state[:, joint] - high[joint])
            misreadings.append(Misreading(joint, "limits", float(past[gone].max()), int(gone.sum())))
    back = np.where(turned, turn, 0.0)
    return command - back, state - back, tuple(misreadings)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
