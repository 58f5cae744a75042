"""Laws beyond the measured range: how far the tip goes with them where nothing was measured.

In the half of a joint's range that was measured, a servo's gain looks like a cable that pulls in proportion; in the
other half both differ. So what a candidate cause says beyond the measured range may be all wrong, and counts as one
standard deviation: of each law by itself, as the errors of two laws are independent. A parameter of a law that no
measured pose shows, such as the gain on the other side of zero, is about as large as those that the poses show.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects import Effect, constant
from lrm_math.effects.base import Extrapolation
from lrm_math.effects.compliance import Compliance
from lrm_math.effects.held_law import HeldLaw
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.effects.targets import Kind, kind_of
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model


def beyond_range(settled: Equilibrium) -> Iterator[Array]:
    """(N, 3), m, of each candidate law: from the tip with the law as it is at the range's edge, to the tip as predicted;
    and of each law's parameter that no pose shows, one standard deviation. Zero within the measured range.

    Raises `NoEquilibrium`.
    """
    model = settled.model
    within = model.within
    if within is None or (within.poses(settled.poses) is settled.poses and not _loaded_beyond(settled, within)):
        return
    ended = () if within.reversion is None else within.reversion.terms
    for law in model.effects:
        if law.name in ended or not _goes_on(law):
            continue
        sizes, candidate = _unseen_sizes(model, law), law.name in model.candidates
        if sizes or candidate:
            held = solve_equilibrium(_with_held(model, law), settled.poses, settled)
            J, J_held = (parameter_jacobian(one, [*sizes]) for one in (settled, held))
            yield from np.moveaxis((J - J_held) * [*sizes.values()], 2, 0)
            if candidate:
                yield settled.true_tcp - held.true_tcp


def _goes_on(effect: Effect) -> bool:
    """Whether its formula is followed beyond the poses of its fit. The springs of the joints, which every arm has, are
    no added law."""
    follows = effect.extrapolation in (Extrapolation.PROPORTIONAL, Extrapolation.PERIODIC) and not constant(effect)
    return follows and not isinstance(effect, Compliance) and kind_of(effect) in (Kind.MOTION, Kind.LOAD)


def _loaded_beyond(settled: Equilibrium, within: MeasuredRange) -> bool:
    """Whether some pose puts a load on a slot that no measured one did."""
    slots = tuple(settled.model.chain.slots[k].key for k in settled.model.load_slots)
    return any(
        not np.array_equal(seen, tau) for seen, tau in zip(within.loads(slots, settled.tau), settled.tau, strict=True)
    )


def _with_held(model: Model, law: Effect) -> Model:
    effects = tuple(HeldLaw(one.arm, one.place, one) if one is law else one for one in model.effects)
    return replace(model, effects=effects)


def _unseen_sizes(model: Model, law: Effect) -> dict[str, float]:
    """Standard deviation (SI) of each parameter of a law that was not fitted beside its others, by its key.

    The size that they share has the typical one as its prior, of one degree of freedom (inverse chi-squared; Gelman et
    al. 2013, section 2.6).
    """
    sizes = {key: one.typical for key, one in zip(law.keys, law.parameters, strict=True) if one.fixed is None}
    seen = [model.value(key) / typical for key, typical in sizes.items() if key in model.free]
    if not seen:
        return {}
    shared = float(np.sqrt((1.0 + np.square(seen).sum()) / (1.0 + len(seen))))
    return {key: shared * typical for key, typical in sizes.items() if key not in model.free}
