"""When the servos got power, as the metadata of a measurement say: joints warm up since then."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array


@dataclass(frozen=True)
class PowerOns:
    """`times`: t_s (s) at which the servos got power, of each session from 1; `temperatures`: of the hottest servo then
    (°C). NaN where that is not known."""

    times: tuple[float, ...] = ()
    temperatures: tuple[float, ...] = ()

    def running(self, t: Array, session: Array) -> Array:
        """(N,), time since the power-on of the session (s); since its first pose where the power-on is not known."""
        began = np.empty(len(t))
        for number in np.unique(session):
            rows = session == number
            known = self.times[int(number) - 1] if 0 < number <= len(self.times) else math.nan
            began[rows] = t[rows].min() if math.isnan(known) else known
        return t - began

    def powered(self, t: Array) -> Array | None:
        """(N,), time since the first power-on (s); None where it is not known."""
        return None if not self.times or math.isnan(self.times[0]) else t - self.times[0]

    def warmed(self, temperature: Array | None) -> Array | None:
        """(N,), temperature less that at the first power-on (K); None where either is not known."""
        known = self.temperatures[0] if self.temperatures else math.nan
        return None if temperature is None or math.isnan(known) else temperature - known


NO_POWER_ONS = PowerOns()
