"""`design`: moves for effects that a model of motion may lack, and what they will tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from lrm_ident.fitting.progress import Progress, silent
from lrm_ident.measuring.excitation.excitation_design import Sensitivities, chosen, sensitivities
from lrm_ident.measuring.excitation.excitations import (
    CollisionFreePaths,
    ExcitingMove,
    as_moves,
    measured,
    offered,
    ramp_speeds,
    random_moves,
    rules_of,
)
from lrm_ident.measuring.excitation.sequence import MoveSequence
from lrm_ident.measuring.excitation.trial import EffectTrial, trials
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.motion.base import JointDrive, MotionEffect
from lrm_math.motion.motion_model import MotionModel


@dataclass(frozen=True)
class MotionDesignTask:
    """What to design.

    Attributes:
        rivals: effects to tell apart, those of one joint among themselves. count: of moves for a joint. noise: of a
            reading: rad of an encoder, m of a tip (`by_tip`). speed: rad/s at most; None: as the ramp allows.
    """

    model: MotionModel
    rivals: tuple[MotionEffect, ...]
    count: int
    noise: float
    by_tip: bool
    speed: float | None = None
    seed: int = 0

    @property
    def speeds(self) -> Array:
        """(n,), rad/s at most. Raises `LrmError`: faster than the ramp."""
        ramp = ramp_speeds(self.model.arm)
        if self.speed is None:
            return ramp
        fastest = float(np.degrees(ramp.min()))
        if self.model.arm.joints[0].servo is not None and self.speed > ramp.min():
            raise LrmError(f"--speed {np.degrees(self.speed):g}: the daemon's ramp allows {fastest:.1f} deg/s at most")
        return np.full(len(ramp), self.speed)

    def check(self) -> None:
        """Raises `LrmError`: effects that cannot be told apart because of how they are named."""
        there = {effect.name for effect in self.model.effects}
        if twice := [effect.name for effect in self.rivals if effect.name in there]:
            raise LrmError(f"{twice[0]} is in the model already; name effects that it lacks")
        if len({effect.name for effect in self.rivals}) < len(self.rivals):
            raise LrmError("an effect is named twice; name each once")
        for effect in self.rivals:
            if effect.alike:
                raise LrmError(f"{effect.name}: no move can show it: {effect.alike}")
            if sum(other.joint == effect.joint for other in self.rivals) < 2:
                raise LrmError(f"{effect.name} is the only one of {effect.place}; name two of a joint at least")


@dataclass(frozen=True)
class DesignedPair:
    """Two effects of one joint, the first of which is there while the model has the second.

    Attributes:
        random, designed: expected held-out error then, over the noise, of random moves and of these. told: whether the
            diagnosis names the first alone, tried with these moves.
    """

    effect: str
    rival: str
    random: float
    designed: float
    told: bool


@dataclass(frozen=True, eq=False)
class MotionDesign:
    """Moves in the order to make them, the sequence of their commands, and what they tell apart."""

    moves: tuple[ExcitingMove, ...]
    sequence: MoveSequence
    pairs: tuple[DesignedPair, ...]
    trials: tuple[EffectTrial, ...]
    offered: int

    def both_told(self) -> dict[tuple[str, str], bool]:
        """Whether two effects are told apart, whichever is there."""
        told = {(pair.effect, pair.rival): pair.told for pair in self.pairs}
        names = sorted({frozenset(pair) for pair in told}, key=sorted)
        return {(a, b): told[a, b] and told[b, a] for a, b in (sorted(pair) for pair in names)}


def motion_design(task: MotionDesignTask, progress: Progress = silent) -> MotionDesign:
    """Designs moves joint by joint. Raises `LrmError`: an effect that no move shows, or no safe move."""
    task.check()
    arm, speeds, rules = task.model.arm, task.speeds, rules_of(task.model.arm)
    joints = sorted({effect.joint for effect in task.rivals})
    rng, many = np.random.default_rng(task.seed), 0
    moves: list[ExcitingMove] = []
    pairs: list[DesignedPair] = []
    tried: list[EffectTrial] = []
    ways = CollisionFreePaths.of(arm, rules)
    plain = random_moves(arm, task.count, speeds, rules, rng)
    for number, joint in enumerate(joints):
        progress("designing the moves", number, len(joints))
        rivals = [effect for effect in task.rivals if effect.joint == joint]
        offer = offered(arm, joint, float(speeds[joint]), rules, task.seed)
        every, usual = (as_moves(arm, some, task.noise, task.by_tip) for some in (offer, plain))
        data = measured(every, joint, task.by_tip)
        _check_testable(rivals, data.drive)
        sensitivities_of = sensitivities(task.model, joint, rivals, data, task.noise)
        picked = chosen(sensitivities_of, task.count)
        beside = sensitivities(task.model, joint, rivals, measured(usual, joint, task.by_tip), task.noise)
        best = [offer[k] for k in picked]
        tried_with = measured(as_moves(arm, best, task.noise, task.by_tip), joint, task.by_tip)
        said = trials(task.model, rivals, tried_with, task.noise, rng)
        pairs += _pairs(rivals, sensitivities_of, picked, beside, said)
        moves += best
        tried += said
        many += len(offer)
    progress("designing the moves", 1, 1)
    sequence = MoveSequence.of(moves, ways, moves[0].q[0], speeds)
    return MotionDesign(tuple(moves), sequence, tuple(pairs), tuple(tried), many)


def _check_testable(rivals: Sequence[MotionEffect], drive: JointDrive) -> None:
    for effect in rivals:
        reason = effect.missing_excitation(drive)
        if reason is not None:
            raise LrmError(f"{effect.name}: no safe move can show it: {reason}")


def _pairs(
    rivals: Sequence[MotionEffect],
    sensitivities_of: Sensitivities,
    picked: NDArray[np.int64],
    beside: Sensitivities,
    said: Sequence[EffectTrial],
) -> list[DesignedPair]:
    these, random = (
        np.sqrt(1.0 + some.noncentrality(some.gram[rows].sum(axis=0)) / some.count[rows].sum())
        for some, rows in ((sensitivities_of, picked), (beside, np.arange(len(beside.gram))))
    )
    out = []
    for k, (a, b) in enumerate(permutations(range(len(rivals)), 2)):
        effect, rival = rivals[a].name, rivals[b].name
        out.append(DesignedPair(effect, rival, float(random[k]), float(these[k]), said[a].told_from(rival)))
    return out
