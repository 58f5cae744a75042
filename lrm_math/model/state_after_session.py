"""State of a model's session effects at the end of its data: what a rover drives with when the session is over.

A drift ends warm, a horn that was put back stays so, and a stretched tracker has moved all measured points by a rigid
motion. Left out with its effect, that state is missing from the lasting parameters that were fitted beside it; so it is
added to the constant offset of the same slot, and the rigid motion to the base. The part of a memory that the load of
the pose itself has made, on average in the session, is a spring: it is added to the compliance of the same slot; what
grows with the angle is a gain.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from lrm_math.arm.arm import BASE
from lrm_math.effects import Effect
from lrm_math.effects.memory.effect_with_memory import EffectWithMemory
from lrm_math.effects.offsets import Offsets
from lrm_math.model.deployed_model import as_deployed, goes_along, of_a_session, with_offsets
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.effect_binding import BoundEffect, distortion
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.lasting_parts import lasting_parts
from lrm_math.model.model import Model
from lrm_math.model.session_state import CarriedState, SessionMemory, StateAfterSession

NO_RANK = 1e-9
"""Singular values below it times the largest are none: of motions of the base that the measured points do not show."""
CLOSE = 1e-7
"""m: tolerance of the equilibrium at which the rigid motion is linearised."""


def usually_carried(effect: Effect) -> CarriedState:
    """State that is carried forward where nothing more is known.

    The end of a law; the mean of a free curve, which follows whatever the order of the poses follows.
    """
    return "mean" if effect.is_free_form else "last"


def passing_effects(model: Model) -> tuple[Effect, ...]:
    """The effects of a model whose state goes along (`goes_along`)."""
    return tuple(filter(goes_along, model.effects))


def state_after_session(
    settled: Equilibrium, carried: Mapping[str, CarriedState] | None = None, warming: Collection[str] | None = None
) -> StateAfterSession | None:
    """State that a fitted model's session effects leave behind; None for a model without such effects.

    It is that of the arm (`state_of_arm`), and the base takes the rigid motion of what a tracker's error moves.
    """
    state = state_of_arm(settled, carried, warming)
    if state is None or not any(of_a_session(bound.effect) for bound in settled.model.binding.distorting):
        return state
    deployed = as_deployed(settled.model.with_state(state))
    base = _rigid_motion(settled, with_offsets(deployed, dict.fromkeys(Offsets(deployed.arm, BASE).keys, 0.0)))
    added = {key: state.offsets.get(key, 0.0) + shift for key, shift in base.items()}
    return replace(state, offsets={**state.offsets, **added})


def state_of_arm(
    settled: Equilibrium, carried: Mapping[str, CarriedState] | None = None, warming: Collection[str] | None = None
) -> StateAfterSession | None:
    """State that session effects leave behind in the arm and its base; None for a model without effects of a session.

    Args:
        settled: its equilibrium at the measured poses, in their order.
        carried: by effect's name; of others those of the model's present state, then `usually_carried`.
        warming: names of effects that follow the time since power-on where it is known; None: those of the model's
            present state.
    """
    model = settled.model
    if not any(of_a_session(effect) for effect in model.effects):
        return None
    carried_states = {**({} if model.state is None else model.state.carried), **(carried or {})}
    chosen = {
        effect.name: carried_states.get(effect.name, usually_carried(effect)) for effect in passing_effects(model)
    }
    bound = {
        bound_effect.effect.name: bound_effect
        for bound_effect in model.binding.bound
        if bound_effect.effect.name in chosen
    }
    lasting = {name: lasting_parts(model, bound[name], settled.poses, chosen[name]) for name in bound}
    sums = Counter[str]()
    for amounts in lasting.values():
        sums.update(amounts)
    follow = model.state.warming if warming is None and model.state is not None else warming or ()
    parts = {name: sum(lasting[name].values()) for name in follow if name in lasting}
    memory = {
        name: SessionMemory(lasting[name], *remembered)
        for name, bound_effect in bound.items()
        if (remembered := _remembered(settled, bound_effect))
    }
    return StateAfterSession(chosen, {key: amount for key, amount in sums.items() if amount}, parts, memory)


def _remembered(settled: Equilibrium, bound: BoundEffect) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Mean and standard deviation of each number of an effect's memory over the session; None of an effect without one,
    or whose time constants are in poses, since no times were measured."""
    history = settled.poses.history
    if not isinstance(bound.effect, EffectWithMemory) or history is None or not history.visits.timed:
        return None
    courses = bound.effect.memory(history.visits, bound.p)
    return tuple(float(x.mean()) for x in courses), tuple(float(x.std()) for x in courses)


def _rigid_motion(settled: Equilibrium, deployed: Model) -> dict[str, float]:
    """The six offsets of the base (rad, m) that move a deployed arm's points most like a tracker's distortion does.

    Of a law its end counts, as of an arm's: a rover is driven in the frame that the tracker shows last.
    """
    keys = Offsets(deployed.arm, BASE).keys
    settled_now = solve_equilibrium(deployed, settled.poses, tolerance=CLOSE)
    true, seen = list(settled.true_tcp.T), np.zeros_like(settled.true_tcp)
    for bound in settled.model.binding.distorting:
        if of_a_session(bound.effect):
            amounts = bound.at(settled.poses)
            if usually_carried(bound.effect) == "last":
                amounts = tuple(np.broadcast_to(amount, len(seen))[-1] for amount in amounts)
            for column, amount in zip(seen.T, distortion(bound, amounts, true), strict=True):
                column += amount
    seen = seen.reshape(-1)
    shift, *_ = np.linalg.lstsq(parameter_jacobian(settled_now, keys).reshape(-1, len(keys)), seen, rcond=NO_RANK)
    return dict(zip(keys, shift.tolist(), strict=True))
