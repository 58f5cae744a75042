"""How hot the servos are: there is no sensor, so only a model can tell.

dT/dt = (T_ambient + rise tau^2 - T) / T_c: copper losses grow with the square of the current, the current with the
torque. Torque is gravity's, from the arm's statics at the commanded angles; a servo without pulses only cools.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from lrmd.config import Config


class Heat(IntEnum):
    """What a temperature means. WARM: loads may not grow; HOT: the arm goes to rest; TOO_HOT: the pulses stop."""

    COOL = 0
    WARM = 1
    HOT = 2
    TOO_HOT = 3


@dataclass(frozen=True)
class Thermal:
    """The servos' model: `ambient` and the limits (degC), `time_constant` (s), `rise` (K/(N m)^2), one per servo."""

    ambient: float
    time_constant: float
    rise: tuple[float, ...]
    limits: tuple[float, float, float]

    @classmethod
    def of(cls, config: Config) -> Thermal:
        """From the daemon's configuration."""
        t = config.thermal
        return cls(t.ambient_c, t.time_constant_s, config.rise, (t.derate_c, t.rest_c, t.off_c))

    def cold(self) -> tuple[float, ...]:
        """Temperatures (degC) of servos that have not run for long."""
        return (self.ambient,) * len(self.rise)

    def after(self, seconds: float, temperature: Sequence[float], tau: Sequence[float]) -> tuple[float, ...]:
        """Temperatures (degC) after `seconds` with torques `tau` (N m), exact for constant torques."""
        left = math.exp(-max(0.0, seconds) / self.time_constant)
        return tuple(
            final + (T - final) * left for T, final in zip(temperature, map(self._final, self.rise, tau), strict=True)
        )

    def _final(self, rise: float, tau: float) -> float:
        return self.ambient + rise * tau * tau

    def heat(self, temperature: float) -> Heat:
        """What one temperature (degC) means."""
        return Heat(sum(temperature >= limit for limit in self.limits))

    def seconds_to(self, limit: float, temperature: float, tau: float, rise: float) -> float:
        """How long until `limit` (degC) with a constant torque; infinite if never, 0 if it is reached."""
        final = self._final(rise, tau)
        if temperature >= limit:
            return 0.0
        if final <= limit:
            return math.inf
        return self.time_constant * math.log((final - temperature) / (final - limit))
