"""The calibrated model: an arm, the effects that act on it, and their parameters."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array, Vector3
from lrm_math.effects import Effect, Parameter, effect_names
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.effects.targets import links_bent_at_ends
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import Chain, Number, chain_of
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.kinematics.statics import Gravity, Weight
from lrm_math.model.effect_binding import BoundEffect, EffectBinding, bind_effect, bind_effects
from lrm_math.model.session_state import StateAfterSession


@dataclass(frozen=True, eq=False)
class ModelStructure:
    """An arm and its effects without values; attributes as of `Model`."""

    arm: Arm
    effects: tuple[Effect, ...]

    @cached_property
    def chain(self) -> Chain:
        """The arm's kinematic chain."""
        return chain_of(self.arm, frozenset().union(*map(links_bent_at_ends, self.effects)))

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """`effect.place.name_unit` of every parameter."""
        return tuple(key for effect in self.effects for key in effect.keys)

    @cached_property
    def positions(self) -> dict[str, int]:
        """Index of each key."""
        return {key: index for index, key in reversed(list(enumerate(self.keys)))}

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every parameter, in the order of `keys`."""
        return tuple(p for e in self.effects for p in e.parameters)

    @cached_property
    def spans(self) -> tuple[slice, ...]:
        """The slice of a model's values that holds each effect's parameters."""
        ends = np.cumsum([0, *(len(e.parameters) for e in self.effects)]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(ends))

    @cached_property
    def load_slots(self) -> tuple[int, ...]:
        """Slots whose load some effect depends on, ascending."""
        index = self.chain.index
        return tuple(sorted({index[key] for e in self.effects for key in e.load_slots if key in index}))

    @cached_property
    def bound(self) -> tuple[BoundEffect, ...]:
        """The effects, bound to the chain's slots, without values."""
        return tuple(bind_effect(self.chain, effect, (), self.load_slots) for effect in self.effects)


CACHED_PAYLOADS = 16


@lru_cache(maxsize=16)  # the deployed models of all folds have one structure
def _structure_of(arm: Arm, effects: tuple[Effect, ...]) -> ModelStructure:
    return ModelStructure(arm, effects)


@dataclass(frozen=True, eq=False)
class Model:
    """An arm with the effects that act on it.

    Attributes:
        values: (P,), parameters of all effects in the order of `keys`, SI.
        free: keys of the parameters that a fit may change; all others are fixed.
        within: range of what the parameters were fitted on, beyond which held effects stay as at its edge; None: not
            known, and nothing is held.
        fitted_to: SHA-256 of the measurements that the parameters were fitted to; None: not known.
        state: state that its effects of a session leave behind, for where they are left out; None: none, or not known.
    """

    arm: Arm
    effects: tuple[Effect, ...]
    values: Array
    free: tuple[str, ...] = ()
    within: MeasuredRange | None = None
    fitted_to: str | None = None
    state: StateAfterSession | None = None

    def __repr__(self) -> str:
        names = ", ".join(effect_names(self.effects)) or "no effects"
        return f"<Model of {self.arm.name}: {names}; {len(self.keys)} parameters, {len(self.free)} free>"

    @cached_property
    def structure(self) -> ModelStructure:
        """The part that does not depend on the parameters' values."""
        return _structure_of(self.arm, self.effects)

    @cached_property
    def chain(self) -> Chain:
        """The arm's kinematic chain."""
        return self.structure.chain

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """`effect.place.name_unit` of every parameter."""
        return self.structure.keys

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every parameter, in the order of `keys`."""
        return self.structure.parameters

    @cached_property
    def spans(self) -> tuple[slice, ...]:
        """The slice of `values` that holds each effect's parameters."""
        return self.structure.spans

    @cached_property
    def load_slots(self) -> tuple[int, ...]:
        """Slots whose load some effect depends on, ascending."""
        return self.structure.load_slots

    @cached_property
    def binding(self) -> EffectBinding:
        """The effects, bound to the chain's slots."""
        parts = zip(self.structure.bound, self.spans, strict=True)
        bound = (replace(b, p=tuple(self.values[span].tolist()), within=self.within) for b, span in parts)
        return bind_effects(self.chain, tuple(bound))

    @property
    def candidates(self) -> tuple[str, ...]:
        """Names of its effects that were added and are no identified causes, where that is known."""
        names = () if self.within is None else self.within.candidates
        return tuple(effect.name for effect in self.effects if effect.name in names)

    @property
    def remembers(self) -> bool:
        """Whether some effect follows the loads that were borne before a pose."""
        return any(effect.remembers for effect in self.effects)

    def parts(self) -> Iterator[tuple[Effect, list[float]]]:
        """Every effect with its parameters' values (SI)."""
        for effect, span in zip(self.effects, self.spans, strict=True):
            yield effect, self.values[span].tolist()

    def __getstate__(self) -> dict[str, object]:
        """The model alone: what was computed from it stays in its process."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def weights(self, carried: Number) -> tuple[Weight, ...]:
        """Every body's mass and centre of mass with a payload (kg), effects included; cached for the last payloads."""
        return self._cached_weights(carried) if isinstance(carried, float) else self._weights(carried)

    @cached_property
    def _cached_weights(self) -> Callable[[float], tuple[Weight, ...]]:
        return lru_cache(maxsize=CACHED_PAYLOADS)(self._weights)

    def _weights(self, carried: Number) -> tuple[Weight, ...]:
        poses = poses_of(np.zeros((np.size(carried), self.arm.dof)), carried)
        added = (change for bound in self.binding.weighing for change in bound.weight_changes(poses))
        return statics.weights(self.chain, carried, added)

    def gravity(self, poses: Poses) -> Gravity:
        """Gravity at poses (m/s²): the arm file's, or in the direction that the poses state; effects included."""
        g: Gravity = self.arm.gravity
        if (down := poses.down) is not None:
            size = math.hypot(*g)
            g = size * down[0], size * down[1], size * down[2]
        for bound in self.binding.leaning:
            x, y, z = bound.at(poses)
            g = g[0] + x, g[1] + y, g[2] + z
        return g

    @cached_property
    def constant_gravity(self) -> Vector3:
        """Gravity where no pose states its direction (m/s²), effects included."""
        x, y, z = map(float, self.gravity(poses_of(np.zeros((1, self.arm.dof)))))
        return x, y, z

    def with_values(self, values: ArrayLike) -> Model:
        """The same model with other parameter values (SI)."""
        return self._alike(replace(self, values=np.asarray(values, dtype=np.float64)))

    def with_values_of(self, keys: Sequence[str], values: ArrayLike) -> Model:
        """The same model with other values (SI) of some parameters. Raises `UnknownName`."""
        changed = self.values.copy()
        changed[[self.position(key) for key in keys]] = values
        return self.with_values(changed)

    def with_free(self, free: Iterable[str]) -> Model:
        """The same model with other free parameters."""
        return self._alike(replace(self, free=tuple(free)))

    def with_state(self, state: StateAfterSession | None) -> Model:
        """The same model with another state of its session effects."""
        return self._alike(replace(self, state=state))

    def _alike(self, other: Model) -> Model:
        """A model of the same effects, which shares this one's structure."""
        vars(other)["structure"] = self.structure
        return other

    def value(self, key: str) -> float:
        """One parameter's value (SI). Raises `UnknownName`."""
        return float(self.values[self.position(key)])

    def parameter(self, key: str) -> Parameter:
        """One parameter. Raises `UnknownName`."""
        return self.parameters[self.position(key)]

    def position(self, key: str) -> int:
        """Index of one parameter in `values`. Raises `UnknownName`."""
        try:
            return self.structure.positions[key]
        except KeyError:
            raise UnknownName("parameter", key, self.keys) from None


def model_of(arm: Arm, effects: Iterable[Effect], values: Mapping[str, float] | None = None) -> Model:
    """A model from effects and parameter values by key (SI); those not given take their default.

    Raises:
        UnknownName: a key that no effect of the model has.
        LrmError: an effect given twice, or a value that is not finite.
    """
    model = Model(arm, tuple(effects), np.empty(0))
    twice = [key for key, count in Counter(model.keys).items() if count > 1]
    if twice:
        raise LrmError(f"effect given twice: {min(twice).rsplit('.', 1)[0]}")
    filled = np.array([parameter.default for parameter in model.parameters], dtype=np.float64)
    for key, value in (values or {}).items():
        if not np.isfinite(value):
            raise LrmError(f"parameter {key} = {value}; should be a finite number")
        filled[model.position(key)] = value
    return model.with_values(filled)
