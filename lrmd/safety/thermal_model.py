"""First-order thermal model of the servo windings, which have no temperature sensor.

dT/dt = (T_ambient + rise tau^2 - T) / T_c: copper losses grow with the square of the current, the current with the
torque. tau is the gravity torque of the rigid arm at the commanded angles; a servo without pulses only cools.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial

from lrm_math.arm.arm import Arm
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.statics import joint_torques
from lrmd.config import Config

Torques = Callable[[Sequence[float], float], Sequence[float]]
"""Gravity torque (N m) on every joint for a pose (rad) and a payload (kg)."""


class ThermalLevel(IntEnum):
    """Range of a temperature. WARM: the torque may not grow; HOT: the arm moves to rest; TOO_HOT: the pulses stop."""

    COOL = 0
    WARM = 1
    HOT = 2
    TOO_HOT = 3


@dataclass(frozen=True)
class ThermalModel:
    """`ambient` and `limits` (degC), `time_constant` (s), `rise` (K/(N m)^2), one per servo."""

    ambient: float
    time_constant: float
    rise: tuple[float, ...]
    limits: tuple[float, float, float]

    @classmethod
    def of(cls, config: Config) -> ThermalModel:
        """The model of a configuration."""
        t = config.thermal
        return cls(t.ambient_c, t.time_constant_s, config.rise, (t.derate_c, t.rest_c, t.off_c))

    def cold(self) -> tuple[float, ...]:
        """Temperatures (degC) at ambient, one per servo."""
        return (self.ambient,) * len(self.rise)

    def after(self, seconds: float, temperature: Sequence[float], tau: Sequence[float]) -> tuple[float, ...]:
        """Temperatures (degC) after `seconds` with torques `tau` (N m), exact for constant torques."""
        left = math.exp(-max(0.0, seconds) / self.time_constant)
        return tuple(
            final + (T - final) * left for T, final in zip(temperature, map(self._final, self.rise, tau), strict=True)
        )

    def _final(self, rise: float, tau: float) -> float:
        return self.ambient + rise * tau * tau

    def level(self, temperature: float) -> ThermalLevel:
        """Level of a temperature (degC)."""
        return ThermalLevel(sum(temperature >= limit for limit in self.limits))

    def seconds_to(self, limit: float, temperature: float, tau: float, rise: float) -> float:
        """Time (s) until `limit` (degC) under a constant torque (N m); infinite if never, 0 if it is reached."""
        final = self._final(rise, tau)
        if temperature >= limit:
            return 0.0
        if final <= limit:
            return math.inf
        return self.time_constant * math.log((final - temperature) / (final - limit))


def gravity_torques(arm: Arm) -> Torques:
    """Function that computes the gravity torques of the rigid nominal arm."""
    return partial(joint_torques, chain_of(arm))
