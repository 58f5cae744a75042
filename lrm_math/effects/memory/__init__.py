"""Effects with a memory: what a joint was sent to and bore before."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_math.effects.base import Effect
from lrm_math.effects.memory.creep import Creep, CreepSpectrum
from lrm_math.effects.memory.self_heating import SelfHeating
from lrm_math.kinematics.history import PACE_S
from lrm_math.kinematics.poses import Poses


def assumed_steps(effects: Sequence[Effect], poses: Poses) -> tuple[str, ...]:
    """The line that tells what is assumed where effects follow times that were not measured."""
    timed = poses.history is None or poses.history.visits.timed
    named = [effect.name for effect in effects if isinstance(effect, Creep | CreepSpectrum | SelfHeating)]
    if timed or not named:
        return ()
    return (
        f"{', '.join(named)}: the data have no times (t_s); poses are taken to follow each other every {PACE_S:g} s",
    )
