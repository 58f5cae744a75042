"""Circumstances of a command that a daemon knows: what a model may depend on where it drives an arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.motion import Motion
from lrm_math.kinematics.poses import Poses


@dataclass(frozen=True, eq=False)
class Known:
    """Circumstances of a command; None where they are not known.

    Attributes:
        motion: record of the moves so far. It is known while all joints have had their pulses without a break since
            somebody knew where the arm stood.
        running: time since the joints have had their pulses (s).
        temperature: of the hottest servo (°C), `warmed`: less that at the beginning of this time (K).
    """

    motion: Motion | None = None
    running: float | None = None
    temperature: float | None = None
    warmed: float | None = None

    def arrived(self, q: Array) -> Motion:
        """The record after a straight move from the present pose to commands q (n,), rad."""
        return Motion.at(q) if self.motion is None else self.motion.to(q)

    def poses(self, arrival: Motion, payload: float = 0.0) -> Poses:
        """The command at the end of a record, with a payload (kg): one pose, for any effect of a model."""
        running, temperature, warmed = map(_one, (self.running, self.temperature, self.warmed))
        return Poses(
            arrival.q[None], np.array([payload]), arrival.side[None], friction=arrival.friction[None],
            t=running, running=running, temperature=temperature, warmed=warmed,
        )  # fmt: skip


def _one(value: float | None) -> Array | None:
    return None if value is None else np.array([value])
