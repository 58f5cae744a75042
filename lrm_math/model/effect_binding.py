"""How the effects of a model are connected to the slots of its chain: names looked up and constants added once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from lrm_math.effects.base import Effect
from lrm_math.kinematics.chain import Chain, Number
from lrm_math.kinematics.poses import Poses, poses_of


@dataclass(frozen=True, eq=False)
class Wired:
    """One effect with its parameters and the slots that it is connected to.

    Attributes:
        p: its parameters' values (SI).
        moves, pushes: numbers of the chain's slots.
        feels: where each load that it feels stands among the loads of the slots `felt`.
        weighs: numbers of the bodies whose weight it changes.
    """

    effect: Effect
    p: tuple[float, ...]
    moves: tuple[int, ...]
    feels: tuple[int, ...]
    pushes: tuple[int, ...]
    weighs: tuple[int, ...]

    def motion(self, poses: Poses, tau: list[Number]) -> Iterable[tuple[int, Number]]:
        """Slots that it moves and by how much, where `tau` are the loads of the slots `felt`."""
        felt = tuple([tau[i] for i in self.feels]) if self.feels else ()
        return zip(self.moves, self.effect.motion(poses, felt, self.p), strict=True)


@dataclass(frozen=True, eq=False)
class Wiring:
    """A model's effects, sorted by what they need to know.

    Attributes:
        steady: amount of every slot with all joints at zero: the nominal arm and the effects that are constant.
        rigid: effects that follow the command but no load, and are no gears.
        gears: of those that are: number of the joint's slot that is turned, of the joint (from 0) that turns it, ratio.
        elastic: effects that feel loads.
        pushing, weighing: effects that put loads on slots, or change weights.
        seeing: effects that change what the tracker sees.
        moving: slots that the elastic effects move, ascending.
        reach: m; no rotation by 1 rad moves the TCP further (the stretched nominal arm, with a margin).
    """

    steady: tuple[float, ...]
    rigid: tuple[Wired, ...]
    gears: tuple[tuple[int, int, float], ...]
    elastic: tuple[Wired, ...]
    pushing: tuple[Wired, ...]
    weighing: tuple[Wired, ...]
    seeing: tuple[Wired, ...]
    moving: tuple[int, ...]
    reach: float


def wire(chain: Chain, parts: Iterable[tuple[Effect, list[float]]], felt: tuple[int, ...]) -> Wiring:
    """The wiring of effects and their parameters (SI) on a chain; `felt`: slots whose load some effect feels."""
    wired = [_wired(chain, effect, p, felt) for effect, p in parts]
    return Wiring(
        steady=_steady(chain, wired),
        rigid=tuple(w for w in wired if w.moves and not (w.feels or w.effect.constant or w.effect.geared)),
        gears=tuple(gear for w in wired if w.effect.geared for gear in _gears(chain, w)),
        elastic=tuple(w for w in wired if w.feels),
        pushing=tuple(w for w in wired if w.pushes),
        weighing=tuple(w for w in wired if w.weighs),
        seeing=tuple(w for w in wired if type(w.effect).seen is not Effect.seen),
        moving=tuple(sorted({k for w in wired if w.feels for k in w.moves})),
        reach=1.2
        * sum(abs(s.nominal) for s in chain.slots if not s.rotates and not s.place.startswith(("base", "link"))),
    )


def _wired(chain: Chain, effect: Effect, p: list[float], felt: tuple[int, ...]) -> Wired:
    moves, feels, pushes = (
        tuple(chain.index[key] for key in keys) for keys in (effect.moves, effect.feels, effect.pushes)
    )
    return Wired(effect, tuple(p), moves, tuple(felt.index(k) for k in feels), pushes, effect.weighs)


def _gears(chain: Chain, wired: Wired) -> Iterable[tuple[int, int, float]]:
    """What an effect makes of each joint's angle alone, where it is not zero."""
    for joint in range(chain.dof):
        one = poses_of([float(i == joint) for i in range(chain.dof)])
        for k, amount in wired.motion(one, []):
            ratio = float(np.asarray(amount).item())
            if ratio:
                yield k, joint, ratio


def _steady(chain: Chain, wired: list[Wired]) -> tuple[float, ...]:
    at_zero = poses_of([0.0] * chain.dof)
    amounts = [float(value) for value in chain.values([0.0] * chain.dof)]
    for place in {chain.slots[k].place for w in wired for k in w.moves}:
        for k, way in chain.hinges(place):
            amounts[k] = way
    for w in wired:
        if w.effect.constant:
            for k, amount in w.motion(at_zero, []):
                amounts[k] += float(amount)
    return tuple(amounts)
