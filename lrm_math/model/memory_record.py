"""Memory of an arm as who drives it keeps it: integrated from what was commanded, by the effects' own formulas.

The numbers are those that a file of the same stands gives (`Visits`): one source for what is shown and what is driven.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.memory.creep import LONG_S
from lrm_math.effects.memory.effect_with_memory import EffectWithMemory
from lrm_math.kinematics.history import History, Visits
from lrm_math.kinematics.known import MemoryState
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import with_borne_loads
from lrm_math.model.model import Model
from lrm_math.model.session_state import SessionMemory

SETTLED, MOST_LOADS = 1e-10, 12
"""N·m (N²m², or a share): change of a memory that counts as none; how often its loads are found."""


def nothing_known(memory: Mapping[str, SessionMemory]) -> MemoryState:
    """Memory of an arm of which nothing is known: as it was in the session of its model, on average."""
    return _likely({name: (memory_state.mean, memory_state.sd) for name, memory_state in memory.items()})


def when_powered(model: Model, memory: Mapping[str, SessionMemory], q: Array, payload: float) -> MemoryState:
    """Memory of an arm that has just got power at commands q (n,), rad, with a payload (kg): rested, or loaded there.

    The mean of both has the least expected squared error where nothing tells which it was.
    model: of the deployed arm with its effects with a memory (`as_deployed_with`).
    """
    rested = MemoryState({name: (0.0,) * len(memory_state.mean) for name, memory_state in memory.items()})
    stood = after_stand(model, rested, q, payload, LONG_S).now
    effects = {effect.name: effect for effect in model.effects if isinstance(effect, EffectWithMemory)}
    return _likely(
        {
            name: effects[name].when_powered(stood[name], memory_state.mean, memory_state.sd)
            for name, memory_state in memory.items()
        }
    )


def _likely(states: Mapping[str, tuple[tuple[float, ...], tuple[float, ...]]]) -> MemoryState:
    """Memories by their means, and each effect's one standard deviation further."""
    mean = {name: numbers for name, (numbers, _) in states.items()}
    uncertain = {name: both for name, both in states.items() if any(both[1])}
    further = {name: tuple(m + s for m, s in zip(*both, strict=True)) for name, both in uncertain.items()}
    return MemoryState(mean, tuple({**mean, name: values} for name, values in further.items()))


def after_stand(
    model: Model, before: MemoryState, q: Array, payload: float, seconds: float, start: Array | None = None
) -> MemoryState:
    """Memory after the arm stood for some time at commands q (n,), rad, with a payload (kg).

    Args:
        model: of the deployed arm with its effects with a memory (`as_deployed_with`).
        before: memory when it came there.
        start: (n,), commands that it came from (rad); None: it did not move.
    """
    load = np.array([payload])
    stand = Visits(q[None], load, np.array([seconds]), np.array([True]), start=start)
    current, *others = (_held(model, replace(stand, begun=begun)) for begun in (before.now, *before.or_else))
    return MemoryState(current, tuple(others))


def _held(model: Model, visits: Visits) -> dict[str, tuple[float, ...]]:
    """Memory after one visit, by effect: what it does moves the load that it follows, so that is found again."""
    poses = Poses(visits.q, visits.payload, history=History(visits, np.array([0])))
    before: list[float] = []
    for _ in range(MOST_LOADS):
        poses = with_borne_loads(model, poses)
        assert poses.history is not None
        memory_found = _memory(model, poses.history.visits)
        numbers = [x for memory in memory_found.values() for x in memory]
        if before and np.abs(np.subtract(numbers, before)).max(initial=0.0) < SETTLED:
            break
        before = numbers
    return memory_found


def _memory(model: Model, visits: Visits) -> dict[str, tuple[float, ...]]:
    return {
        effect.name: tuple(float(course[-1]) for course in effect.memory(visits, p))
        for effect, p in model.parts()
        if isinstance(effect, EffectWithMemory) and effect.name in (visits.begun or {})
    }
