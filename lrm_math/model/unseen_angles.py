"""Candidate laws beyond the measured range: how far the tip goes with them where nothing was measured.

In the half of a joint's range that was measured a servo's gain looks like a cable that pulls in proportion; in the
other half both differ. So what an effect that is no identified cause says beyond the measured range may be all wrong,
and counts as one standard deviation: of each by itself, as the errors of two laws are independent.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.effects.base import Extrapolation
from lrm_math.effects.held_law import HeldLaw
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.effects.targets import Kind, kind_of
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model


def beyond_range(settled: Equilibrium) -> Iterator[Array]:
    """(N, 3), m, of each candidate law: from the tip with the law as it is at the range's edge, to the tip as
    predicted. Zero within the range; none where no pose is outside. Raises `NoEquilibrium`.
    """
    model, within = settled.model, settled.model.within
    if within is not None and model.candidates and _outside(settled, within):
        ended = () if within.reversion is None else within.reversion.terms
        for law in model.effects:
            if law.name in model.candidates and law.name not in ended and _goes_on(law):
                yield settled.true_tcp - solve_equilibrium(_with_held(model, law), settled.poses, settled).true_tcp


def _outside(settled: Equilibrium, within: MeasuredRange) -> bool:
    """Whether some pose has an angle, a payload, or a load on a slot, that no measured one had."""
    slots = tuple(settled.model.chain.slots[k].key for k in settled.model.load_slots)
    loads = zip(within.loads(slots, settled.tau), settled.tau, strict=True)
    return within.poses(settled.poses) is not settled.poses or not all(np.array_equal(*pair) for pair in loads)


def _goes_on(effect: Effect) -> bool:
    """Whether its formula is followed beyond the poses of its fit."""
    follows = effect.extrapolation in (Extrapolation.PROPORTIONAL, Extrapolation.PERIODIC)
    return follows and kind_of(effect) in (Kind.MOTION, Kind.LOAD)


def _with_held(model: Model, law: Effect) -> Model:
    effects = tuple(HeldLaw(effect.arm, effect.place, effect) if effect is law else effect for effect in model.effects)
    return replace(model, effects=effects)
