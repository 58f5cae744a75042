"""Effects of a model bound to the slots of its chain: keys resolved to slot numbers, constant motions summed once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects import constant
from lrm_math.effects.base import Amounts, Effect, Extrapolation, LinearEffect
from lrm_math.effects.compliance import Spring
from lrm_math.effects.derivatives import Rows, amounts_within, by_angles, by_loads, by_parameters
from lrm_math.effects.measured_range import MeasuredRange, held
from lrm_math.effects.offsets import Offsets
from lrm_math.effects.reversion_correction import ReversionCorrection
from lrm_math.effects.targets import BODY, BODY_AMOUNTS, FRAME, RADIAL, SCALE, SERVO, Kind, kind_of, slot_of
from lrm_math.errors import UnknownName
from lrm_math.kinematics.chain import Chain, Number, is_zero
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.kinematics.scalar_or_array import linear_combination
from lrm_math.kinematics.statics import WeightChange

AXES = "xyz"
LENGTHS = (f"{FRAME}{SCALE}",)
"""Targets of effects that scale all lengths."""


@dataclass(frozen=True, eq=False)
class KnownBasis:
    """An effect's basis at some poses, within the range of a fit."""

    rows: Rows
    within: MeasuredRange | None

    @cached_property
    def stacked(self) -> tuple[tuple[list[int], Array], ...] | None:
        """Of each target the K parameters that move it, and their functions (K, N); None where some are numbers."""
        columns = [[(i, f) for i, f in enumerate(column) if not is_zero(f)] for column in zip(*self.rows, strict=True)]
        if not all(isinstance(f, np.ndarray) for column in columns for _, f in column):
            return None
        return tuple(([i for i, _ in column], np.array([f for _, f in column])) for column in columns)

    def combined(self, p: Sequence[float]) -> Amounts:
        """Σ p_i f_i for each target."""
        if self.stacked is None:
            return linear_combination(p, self.rows, len(self.rows[0]))
        values = np.array(p)
        return tuple([values[moved] @ functions if moved else 0.0 for moved, functions in self.stacked])


class Bases(WeakKeyDictionary[Poses, KnownBasis]):
    """An effect's basis at poses, as long as these exist; it stays in its process."""

    def __reduce__(self) -> tuple[type[Bases], tuple[()]]:
        return Bases, ()


@dataclass(frozen=True, eq=False)
class BoundEffect:
    """One effect with its parameter values and the numbers of the slots that it acts on.

    Attributes:
        p: its parameters' values (SI).
        kind: what its targets are.
        slots: numbers of the chain's slots that it moves or loads, in the order of its targets.
        encoders: numbers from 0 of the joints whose encoder reads what it moves, for each of them; else None.
        loads: index into `Model.load_slots` of each load that enters its amounts.
        constant: whether it moves slots by the same amounts whatever the pose, load and direction.
        within: range of the fit, at whose edge a held effect stays; None where it is not known.
        bases: the basis of a linear effect at poses that it was computed for, as long as these exist.
    """

    effect: Effect
    p: tuple[float, ...]
    kind: Kind
    slots: tuple[int, ...]
    encoders: tuple[int | None, ...]
    loads: tuple[int, ...]
    constant: bool
    within: MeasuredRange | None = None
    bases: Bases = field(default_factory=Bases, repr=False)

    @property
    def idle(self) -> bool:
        """Whether it adds nothing, since it is linear in its parameters, or a spring, and these are zero."""
        if isinstance(self.effect, Spring):
            return not any(self.effect.compliances(self.p))
        return isinstance(self.effect, LinearEffect) and not any(self.p)

    def amounts(self, poses: Poses, tau: Sequence[Number]) -> Iterable[tuple[int, Number]]:
        """Slots that it moves or loads, and the amounts, where `tau` are the loads on `Model.load_slots` (N·m)."""
        if self.idle:
            return zip(self.slots, (0.0,) * len(self.slots), strict=True)
        return zip(self.slots, self.at(poses, self.own_loads(tau)), strict=True)

    def at(self, poses: Poses, own_loads: Amounts = ()) -> Amounts:
        """Amount added to each target, where the loads on the effect's own `load_slots` are `own_loads`."""
        if isinstance(self.effect, LinearEffect) and self.effect.keeps_basis and not self.loads:
            return self._known_basis(poses).combined(self.p)
        return amounts_within(self.effect, poses, own_loads, self.p, self.within)

    def by_parameters(self, poses: Poses, tau: Sequence[Number], chosen: Sequence[int]) -> Rows:
        """∂amount/∂p: for each of the parameters `chosen` by number one number or (N,) for each target."""
        if isinstance(self.effect, LinearEffect):
            basis = self._basis(poses, tau)
            return tuple([basis[row] for row in chosen])
        return by_parameters(self.effect, poses, self.own_loads(tau), self.p, self.within, chosen)

    def by_loads(self, poses: Poses, own_loads: Amounts) -> Rows:
        """∂`at`/∂loads: for each load that it depends on one number or (N,) for each target."""
        return by_loads(self.effect, poses, own_loads, self.p, self.within)

    def by_angles(self, poses: Poses, own_loads: Amounts) -> Rows:
        """∂`at`/∂q, of the commanded angles: for each joint one number or (N,) for each target."""
        return by_angles(self.effect, poses, own_loads, self.p, self.within)

    def _basis(self, poses: Poses, tau: Sequence[Number]) -> Rows:
        """The basis of a linear effect."""
        if self.loads:
            return by_parameters(self.effect, poses, self.own_loads(tau), self.p, self.within)
        return self._known_basis(poses).rows

    def _known_basis(self, poses: Poses) -> KnownBasis:
        """The basis of a linear effect that follows from the poses alone, computed once for them and the same range."""
        basis_known = self.bases.get(poses)
        if basis_known is None or basis_known.within is not self.within:
            basis_known = KnownBasis(by_parameters(self.effect, poses, (), self.p, self.within), self.within)
            self.bases[poses] = basis_known
        return basis_known

    def own_loads(self, tau: Sequence[Number]) -> Amounts:
        """The loads that enter its amounts, from those on `Model.load_slots`."""
        return tuple([tau[i] for i in self.loads]) if self.loads else ()

    def weight_changes(self, poses: Poses) -> Iterator[tuple[int, WeightChange]]:
        """Numbers of the bodies whose weight it changes, and the changes."""
        return changes_of(self.effect, self.at(poses))


@dataclass(frozen=True, eq=False)
class EffectBinding:
    """A model's effects by what their amounts depend on and act on.

    Attributes:
        bound: all of them, in the model's order.
        constants: amount of every slot with all joints at zero: the nominal arm and the effects that are constant.
        rigid: effects that move slots with the command but with no load.
        elastic: effects that move slots by loads; nonlinear: those of them that are no linear springs.
        springs: (M, K), compliance of the linear springs: motion of the `moving` slots by the K loads (rad/N·m, m/N·m).
        loading, weighing: effects that put loads on slots, or change weights.
        leaning: effects that turn gravity.
        distorting, anchoring: effects that distort the tracker's measurement, or shift the anchor of distances.
        moving: slots that the elastic effects move, ascending.
        reach: m; the most that a rotation by 1 rad can move the TCP (the stretched nominal arm, with a margin).
    """

    bound: tuple[BoundEffect, ...]
    constants: tuple[float, ...]
    rigid: tuple[BoundEffect, ...]
    elastic: tuple[BoundEffect, ...]
    nonlinear: tuple[BoundEffect, ...]
    springs: Array
    loading: tuple[BoundEffect, ...]
    weighing: tuple[BoundEffect, ...]
    leaning: tuple[BoundEffect, ...]
    distorting: tuple[BoundEffect, ...]
    anchoring: tuple[BoundEffect, ...]
    moving: tuple[int, ...]
    reach: float

    def of_class(self, kind: type[Any]) -> list[BoundEffect]:
        """The elastic effects of one class, such as springs."""
        return [bound for bound in self.elastic if isinstance(bound.effect, kind)]


def bind_effects(chain: Chain, bound: tuple[BoundEffect, ...]) -> EffectBinding:
    """The binding of a model's effects, each bound to the chain; what returns beyond their range among what acts."""
    acting = (*bound, *_returning(bound))
    of_kind = {kind: tuple(b for b in acting if b.kind is kind) for kind in Kind}
    motions = of_kind[Kind.MOTION]
    elastic = tuple(b for b in motions if b.loads)
    moving = tuple(sorted({k for b in elastic for k in b.slots}))
    return EffectBinding(
        bound=bound,
        constants=_constants(chain, motions),
        rigid=tuple(b for b in motions if not (b.loads or b.constant)),
        elastic=elastic,
        nonlinear=tuple(b for b in elastic if not isinstance(b.effect, Spring)),
        springs=_springs(elastic, moving, 1 + max((i for b in bound for i in b.loads), default=-1)),
        loading=of_kind[Kind.LOAD],
        weighing=of_kind[Kind.WEIGHT],
        leaning=of_kind[Kind.GRAVITY],
        distorting=of_kind[Kind.FRAME],
        anchoring=of_kind[Kind.ANCHOR],
        moving=moving,
        reach=1.2 * chain.length,
    )


def bind_effect(
    chain: Chain, effect: Effect, p: Sequence[float], load_slots: Sequence[int], within: MeasuredRange | None = None
) -> BoundEffect:
    """One effect, bound."""
    kind, targets = kind_of(effect), effect.targets
    keys = [slot_of(target) for target in targets] if kind in (Kind.MOTION, Kind.LOAD) else []
    for key in (*keys, *effect.load_slots):
        if key not in chain.index:
            raise UnknownName(f"slot of effect {effect.name}", key, chain.index)
    slots = tuple(chain.index[key] for key in keys)
    encoders = tuple(chain.slots[k].joint if t.endswith(SERVO) else None for k, t in zip(slots, targets, strict=False))
    loads = tuple(load_slots.index(chain.index[key]) for key in effect.load_slots)
    return BoundEffect(effect, tuple(p), kind, slots, encoders, loads, constant(effect), within)


def _returning(bound: Sequence[BoundEffect]) -> Iterator[BoundEffect]:
    """Changes of effects beyond the range in which the model's empirical terms hold; none where one of these is not in
    the model."""
    within = next((b.within for b in bound), None)
    reversion = None if within is None else within.reversion
    if within is None or reversion is None or not {*reversion.terms} <= {b.effect.name for b in bound}:
        return
    for bound_effect in bound:
        changes = [reversion.changes.get(key, 0.0) for key in bound_effect.effect.keys]
        if any(changes) and bound_effect.kind in (Kind.MOTION, Kind.LOAD):
            rows = tuple(
                k for k in range(len(bound_effect.slots)) if not isinstance(bound_effect.effect, Offsets) or changes[k]
            )
            away = tuple(value + change for value, change in zip(bound_effect.p, changes, strict=True))
            effect = ReversionCorrection(
                bound_effect.effect.arm,
                bound_effect.effect.place,
                bound_effect.effect,
                rows,
                bound_effect.p,
                away,
                within,
                reversion,
            )
            slots = tuple(bound_effect.slots[row] for row in rows)
            encoders = tuple(bound_effect.encoders[row] for row in rows)
            yield replace(
                bound_effect, effect=effect, p=(), slots=slots, encoders=encoders, constant=False, bases=Bases()
            )


def changes_of(effect: Effect, amounts: Amounts) -> Iterator[tuple[int, WeightChange]]:
    """Numbers of bodies, and their changes by an effect's amounts."""
    size = len(BODY_AMOUNTS)
    for first in range(0, len(amounts), size):
        mass, x, y, z = amounts[first : first + size]
        yield int(effect.targets[first].partition(".")[0].removeprefix(BODY)), WeightChange(mass, (x, y, z))


def distortion(bound: BoundEffect, amounts: Amounts, position: Sequence[Number]) -> list[Number]:
    """Terms that a tracker adds to the three components of a position (m) by `amounts` at the effect's targets."""
    return list(linear_combination(amounts, frame_basis(bound, position), len(AXES)))


def frame_basis(bound: BoundEffect, position: Sequence[Number]) -> Rows:
    """Terms that one unit at each target of an effect of the tracker's frame adds to the components of a position (m).

    Where the effect is held, it sees the position within the range of the fit. A distortion is about the centre of what
    was measured, so that it moves the measured points least; a scale of all lengths and a rigid motion are about the
    base's origin.
    """
    ends, centre = (None, None) if bound.within is None else (bound.within.tcp, bound.within.centre)
    seen = list(position)
    if ends is not None and bound.effect.extrapolation is Extrapolation.HELD:
        seen = [held(value, *within) for value, within in zip(position, ends, strict=True)]
    if bound.effect.targets == LENGTHS:
        return (tuple(seen),)
    names = [target.removeprefix(FRAME) for target in bound.effect.targets]
    if centre is not None and not {*AXES} & {*names}:
        seen = [value - middle for value, middle in zip(seen, centre, strict=True)]
    products = {term: _product(term, seen) for term in {name[1:] for name in names} - {"", RADIAL}}
    square = _product("xx", seen) + _product("yy", seen) + _product("zz", seen)

    def of_target(name: str) -> Amounts:
        """Amounts along the three axes of a target, `x` or `xyz`-like: an axis, then a term of the coordinates."""
        row = AXES.index(name[0])
        if len(name) == 1:
            return tuple(float(axis == row) for axis in range(len(AXES)))
        term = seen[row] * square if name[1:] == RADIAL else products[name[1:]]
        return tuple(term if axis == row else 0.0 for axis in range(len(AXES)))

    return tuple(map(of_target, names))


def _product(axes: str, position: Sequence[Number]) -> Number:
    """The product of one or two components of a position."""
    first, *others = (position[AXES.index(axis)] for axis in axes)
    return first * others[0] if others else first


def anchor_shift(effect: Effect, amounts: Amounts) -> Array:
    """(3,), shift of the fixed point of measured distances (m)."""
    amount_of = dict(zip((target.partition(".")[2] for target in effect.targets), amounts, strict=True))
    return np.array([float(amount_of.get(axis, 0.0)) for axis in AXES])


def _springs(elastic: Iterable[BoundEffect], moving: Sequence[int], loads: int) -> Array:
    out = np.zeros((len(moving), loads))
    for bound in elastic:
        if isinstance(bound.effect, Spring):
            for k, i, compliance in zip(bound.slots, bound.loads, bound.effect.compliances(bound.p), strict=True):
                out[moving.index(k), i] += compliance
    return out


@lru_cache(maxsize=16)
def _pose_at_zero(dof: int) -> Poses:
    return poses_of([0.0] * dof)


def _constants(chain: Chain, motions: Iterable[BoundEffect]) -> tuple[float, ...]:
    at_zero = _pose_at_zero(chain.dof)
    out = [float(value) for value in chain.values([0.0] * chain.dof)]
    for place in {chain.slots[k].place for bound in motions for k in bound.slots}:
        for k, length in chain.hinges.get(place, ()):
            out[k] = length
    for bound in motions:
        if bound.constant:
            for k, amount in bound.amounts(at_zero, []):
                out[k] += float(amount)
    return tuple(out)
