"""Structure of a model that its effects determine without their parameters' values: shared by all iterates of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.effects import Effect, Parameter
from lrm_math.effects.targets import links_bent_at_ends
from lrm_math.kinematics.chain import Chain, chain_of
from lrm_math.model.effect_binding import BoundEffect, bind_effect


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
