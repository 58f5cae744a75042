"""Thermal monitor: the modelled servo temperatures over time, and changes of their levels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from lrmd.config import SECOND, Config
from lrmd.errors import RequestError
from lrmd.persistence.state_file import StoredState
from lrmd.safety.thermal_model import ThermalLevel, ThermalModel

STEPS = 100
"""Updates within one time constant, at least; once a second for slow servos."""


@dataclass(frozen=True)
class LevelChange:
    """Servo number `servo` changed from one thermal level to another."""

    servo: int
    before: ThermalLevel
    after: ThermalLevel


class ThermalMonitor:
    """`temperature` (degC) and `tau` (N m) per servo at the last `update`; times in monotonic ns."""

    def __init__(self, config: Config, stored: StoredState | None, now: int, wall: int) -> None:
        self.model = ThermalModel.of(config)
        self._names = config.names
        self._at = now
        self._interval = min(SECOND, round(self.model.time_constant * SECOND / STEPS))
        self._levels = [ThermalLevel.COOL] * len(config.servos)
        self.tau: tuple[float, ...] = (0.0,) * len(config.servos)
        self.temperature = self._cooled(stored, wall)

    def _cooled(self, stored: StoredState | None, wall: int) -> tuple[float, ...]:
        """Stored temperatures (degC), cooled for the time since by the wall clock (ns)."""
        cold = self.model.cold()
        if stored is None:
            return cold
        was = tuple(stored.temperature_c.get(n, T) for n, T in zip(self._names, cold, strict=True))
        return self.model.after((wall - stored.saved_wall_ns) / SECOND, was, (0.0,) * len(cold))

    def due(self, now: int) -> bool:
        """Whether the time for the next update has come."""
        return now - self._at >= self._interval

    def level(self, servo: int) -> ThermalLevel:
        """Level of servo number `servo`."""
        return self.model.level(self.temperature[servo])

    def hottest(self, servos: int) -> int | None:
        """Number of the hottest servo of some (bits), None without any."""
        chosen = [i for i in range(len(self.temperature)) if servos >> i & 1]
        return max(chosen, key=self.temperature.__getitem__, default=None)

    def cooling_time(self, servo: int) -> float:
        """Time (s) until a servo without pulses is no longer too hot."""
        model, limit = self.model, self.model.limits[ThermalLevel.TOO_HOT - 1]
        warmer = (self.temperature[servo] - model.ambient) / (limit - model.ambient)
        return model.time_constant * math.log(max(1.0, warmer))

    @property
    def time_to_hot(self) -> list[float]:
        """Seconds until each servo is hot under constant torques; infinite if never."""
        limit, model = self.model.limits[ThermalLevel.HOT - 1], self.model
        return [
            model.seconds_to(limit, T, tau, rise)
            for T, tau, rise in zip(self.temperature, self.tau, model.rise, strict=True)
        ]

    def update(self, now: int, tau: Sequence[float]) -> list[LevelChange]:
        """Integrates to `now` (ns) under torques `tau` (N m, 0 without pulses); returns the changed levels.

        The first update compares with COOL: a servo that was stored hot is reported, too.
        """
        seconds, self._at = (now - self._at) / SECOND, now
        before = self._levels
        self.tau = tuple(tau)
        self.temperature = self.model.after(seconds, self.temperature, self.tau)
        self._levels = [self.model.level(T) for T in self.temperature]
        changes = [LevelChange(i, old, new) for i, (old, new) in enumerate(zip(before, self._levels, strict=True))]
        return [change for change in changes if change.before is not change.after]

    def check_load(self, now: Sequence[float], then: Sequence[float]) -> None:
        """Raises `RequestError` if a warm servo would carry more torque `then` than `now` (N m, per servo)."""
        for name, before, after, T in zip(self._names, now, then, self.temperature, strict=True):
            if self.model.level(T) >= ThermalLevel.WARM and abs(after) > abs(before) + 1e-9:
                raise RequestError(
                    "too_warm",
                    f"{name} is at {T:.0f} degC and would hold {abs(after):.2f} instead of {abs(before):.2f} Nm; "
                    "go where it carries less, or let it cool",
                    retryable=True, servo=name,
                )  # fmt: skip
