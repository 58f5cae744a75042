"""Laws that are followed beyond what their session showed: how far the tip goes with them where nothing was measured.

A law of the time since power-on, or of what the arm did before, is known from the states that its session had. In the
other half of a joint's range a creep has the load on the other side, and a warm-up goes on after the last pose. What
the law says beyond those states may be all wrong, so it counts as one standard deviation: of each law by itself, as
the errors of two laws are independent.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.memory.effect_with_memory import EffectWithMemory
from lrm_math.kinematics.history import History, Visits
from lrm_math.kinematics.poses import Poses
from lrm_math.model.deployed_model import as_deployed_with, followed_effects
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.session_state import SessionMemory

SEEN = 2.0
"""Standard deviations from its mean in the session within which a memory is taken as seen."""


def beyond_session(model: Model, current: Poses) -> list[Array]:
    """(3,), m, of each followed law: from the tip with it at the nearest state that the session had, to the tip now.

    The other laws stay at the state that is deployed where they are not followed. Zero where the session had the state
    of now. `current`: one pose, its history with the loads that it bore (`with_borne_loads`). Raises `NoEquilibrium`.
    """
    return [_beyond_session(model, name, current) for name in followed_effects(model, current)]


def _beyond_session(model: Model, name: str, current: Poses) -> Array:
    deployed = as_deployed_with(model, [name])
    seen = _with_seen_memory(model, deployed, _with_seen_times(model, name, current))
    if seen is current:
        return np.zeros(3)
    there, within = (solve_equilibrium(deployed, poses).true_tcp[0] for poses in (current, seen))
    return np.asarray(there - within)


def _with_seen_times(model: Model, name: str, current: Poses) -> Poses:
    """The pose at the nearest time that was measured, if the law follows the time."""
    if model.within is None or model.state is None or name not in model.state.warming:
        return current
    seen: dict[str, Any] = {}
    for clock, ends in (("t", model.within.t), ("running", model.within.running)):
        time = getattr(current, clock)
        if ends is not None and time is not None and (nearest := np.clip(time, *ends)) != time:
            seen[clock] = nearest
    return replace(current, **seen) if seen else current


def _with_seen_memory(model: Model, deployed: Model, current: Poses) -> Poses:
    """The pose with the nearest memory that the session had, as if it had just come there."""
    if current.history is None or model.state is None:
        return current
    visits, row = current.history.visits, int(current.history.row[0])
    memory = {
        effect.name: tuple(float(course[row]) for course in effect.memory(visits, p))
        for effect, p in deployed.parts()
        if isinstance(effect, EffectWithMemory) and effect.name in model.state.memory
    }
    seen = {name: _nearest_seen(model.state.memory[name], numbers) for name, numbers in memory.items()}
    if seen == memory:
        return current
    held = Visits(current.q, current.payload, np.zeros(1), np.array([True]), current.gravity, begun=seen)
    return replace(current, history=History(held, np.array([0])))


def _nearest_seen(session: SessionMemory, numbers: tuple[float, ...]) -> tuple[float, ...]:
    visited = zip(numbers, session.mean, session.sd, strict=True)
    return tuple(min(max(x, mean - SEEN * sd), mean + SEEN * sd) for x, mean, sd in visited)
