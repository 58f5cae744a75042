"""Effects of a model bound to the slots of its chain: keys resolved to slot numbers, constant motions summed once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np

from lrm_math.effects.base import Effect
from lrm_math.kinematics.chain import Chain, Number
from lrm_math.kinematics.poses import Poses, poses_of


@dataclass(frozen=True, eq=False)
class BoundEffect:
    """One effect with its parameter values and the numbers of the slots that it acts on.

    Attributes:
        p: its parameters' values (SI).
        moves, pushes: numbers of the chain's slots.
        feels: index into `Model.load_slots` of each load that it feels.
        weighs: numbers of the bodies whose weight it changes.
    """

    effect: Effect
    p: tuple[float, ...]
    moves: tuple[int, ...]
    feels: tuple[int, ...]
    pushes: tuple[int, ...]
    weighs: tuple[int, ...]

    def motion(self, poses: Poses, tau: list[Number]) -> Iterable[tuple[int, Number]]:
        """Slots that it moves, and the amounts, where `tau` are the loads on `Model.load_slots` (N·m)."""
        loads = tuple([tau[i] for i in self.feels]) if self.feels else ()
        return zip(self.moves, self.effect.motion(poses, loads, self.p), strict=True)


@dataclass(frozen=True, eq=False)
class EffectBinding:
    """A model's effects by what their motion depends on.

    Attributes:
        constants: amount of every slot with all joints at zero: the nominal arm and the effects that are constant.
        rigid: effects that depend on the command but on no load, other than `gears`.
        gears: motions proportional to a joint angle: number of the slot moved, of the joint (from 0), ratio.
        elastic: effects that feel loads.
        pushing, weighing: effects that put loads on slots, or change weights.
        distorting: effects that distort the tracker's measurement.
        moving: slots that the elastic effects move, ascending.
        reach: m; the most that a rotation by 1 rad can move the TCP (the stretched nominal arm, with a margin).
    """

    constants: tuple[float, ...]
    rigid: tuple[BoundEffect, ...]
    gears: tuple[tuple[int, int, float], ...]
    elastic: tuple[BoundEffect, ...]
    pushing: tuple[BoundEffect, ...]
    weighing: tuple[BoundEffect, ...]
    distorting: tuple[BoundEffect, ...]
    moving: tuple[int, ...]
    reach: float


def bind_effects(
    chain: Chain, parts: Iterable[tuple[Effect, list[float]]], load_slots: tuple[int, ...]
) -> EffectBinding:
    """Binds effects and their parameters (SI) to a chain; `load_slots`: slots whose load some effect feels."""
    bound = [_bound(chain, effect, p, load_slots) for effect, p in parts]
    return EffectBinding(
        constants=_constants(chain, bound),
        rigid=tuple(w for w in bound if w.moves and not (w.feels or w.effect.constant or w.effect.geared)),
        gears=tuple(gear for w in bound if w.effect.geared for gear in _gears(chain, w)),
        elastic=tuple(w for w in bound if w.feels),
        pushing=tuple(w for w in bound if w.pushes),
        weighing=tuple(w for w in bound if w.weighs),
        distorting=tuple(w for w in bound if type(w.effect).seen is not Effect.seen),
        moving=tuple(sorted({k for w in bound if w.feels for k in w.moves})),
        reach=1.2 * chain.length,
    )


def _bound(chain: Chain, effect: Effect, p: list[float], load_slots: tuple[int, ...]) -> BoundEffect:
    moves, feels, pushes = (
        tuple(chain.index[key] for key in keys) for keys in (effect.moves, effect.feels, effect.pushes)
    )
    return BoundEffect(effect, tuple(p), moves, tuple(load_slots.index(k) for k in feels), pushes, effect.weighs)


def _gears(chain: Chain, effect: BoundEffect) -> Iterable[tuple[int, int, float]]:
    """Slot, joint and ratio of every joint angle that the effect transmits."""
    for joint, one in enumerate(_unit_poses(chain.dof)):
        for k, amount in effect.motion(one, []):
            ratio = float(np.asarray(amount).item())
            if ratio:
                yield k, joint, ratio


@cache
def _unit_poses(dof: int) -> tuple[Poses, ...]:
    """One pose for each joint, with that joint alone at 1 rad."""
    return tuple(poses_of(row) for row in np.eye(dof))


def _constants(chain: Chain, bound: list[BoundEffect]) -> tuple[float, ...]:
    at_zero = poses_of([0.0] * chain.dof)
    amounts = [float(value) for value in chain.values([0.0] * chain.dof)]
    for place in {chain.slots[k].place for w in bound for k in w.moves}:
        for k, length in chain.hinges.get(place, ()):
            amounts[k] = length
    for w in bound:
        if w.effect.constant:
            for k, amount in w.motion(at_zero, []):
                amounts[k] += float(amount)
    return tuple(amounts)
