"""Circumstances of a command that a daemon knows: what a model may depend on where it drives an arm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.history import History, Visits
from lrm_math.kinematics.motion import Motion
from lrm_math.kinematics.poses import Poses

WAY_PARTS = 4
"""Parts of a move at whose middles the loads along it are taken."""


@dataclass(frozen=True, eq=False)
class MemoryState:
    """Memory of an arm's effects, by name, that is followed while its moves are known.

    Attributes:
        now: memory of each (`EffectWithMemory.memory`). or_else: the same, one for each effect of which something is
            not known: that effect's memory one standard deviation further.
    """

    now: Mapping[str, tuple[float, ...]]
    or_else: tuple[Mapping[str, tuple[float, ...]], ...] = ()


@dataclass(frozen=True, eq=False)
class Known:
    """Circumstances of a command; None where they are not known.

    Attributes:
        motion: record of the moves so far. It is known while all joints have had their pulses without a break since
            somebody knew where the arm stood.
        running: time since the joints have had their pulses (s).
        temperature: of the hottest servo (°C), `warmed`: less that at the beginning of this time (K).
        remembered: by effects that follow what the arm did before.
    """

    motion: Motion | None = None
    running: float | None = None
    temperature: float | None = None
    warmed: float | None = None
    remembered: MemoryState | None = None

    def arrived(self, q: Array) -> Motion:
        """The record after a straight move from the present pose to commands q (n,), rad."""
        return Motion.at(q) if self.motion is None else self.motion.to(q)

    def poses(self, arrival: Motion, payload: float = 0.0, seconds: float = 0.0) -> Poses:
        """The command at the end of a record, with a payload (kg): one pose, for any effect of a model.

        `seconds`: that the way there takes. The time since power-on is that of arrival, temperatures are those of now.
        """
        arrived = None if self.running is None else self.running + seconds
        running, temperature, warmed = map(_one, (arrived, self.temperature, self.warmed))
        history = None if self.remembered is None else self._history(self.remembered, arrival.q, payload, seconds)
        return Poses(
            arrival.q[None], np.array([payload]), arrival.side[None], friction=arrival.friction[None],
            t=running, running=running, temperature=temperature, warmed=warmed, history=history,
        )  # fmt: skip

    def _history(self, remembered: MemoryState, q: Array, payload: float, seconds: float) -> History:
        """The middles of the parts of the way from here, and the command q (n,), rad, at its end."""
        assert self.motion is not None
        here, parts = self.motion.q, (np.arange(WAY_PARTS) + 0.5) / WAY_PARTS
        way = here + parts[:, None] * (q - here)
        step = np.array([*(seconds / WAY_PARTS,) * WAY_PARTS, 0.0])
        begins = np.arange(len(step)) == 0
        visits = Visits(
            np.vstack([way, q]), np.full(len(step), payload), step, begins, start=here, begun=remembered.now
        )
        return History(visits, np.array([len(step) - 1]))


def _one(value: float | None) -> Array | None:
    return None if value is None else np.array([value])
