"""First-order thermal model of the servo windings, which have no temperature sensor.

dT/dt = (T_ambient + rise tau^2 - T) / T_c: copper losses grow with the square of the current, the current with the
torque. tau is the gravity torque of the rigid arm at the commanded angles; a servo without pulses only cools.

The monitor has the modelled temperatures over time, and tells changes of their levels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Vector3
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.statics import joint_torques
from lrmd.config import SECOND, Config
from lrmd.errors import RequestError
from lrmd.persistence.state_file import StoredState

Torques = Callable[[Sequence[float], float, Vector3], Sequence[float]]
"""Gravity torque (N m) on every joint for a pose (rad), a payload (kg) and its centre (m, see `Arm.with_load_at`)."""
STEPS = 100
"""Updates within one time constant, at least; once a second for slow servos."""


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
        share_left = math.exp(-max(0.0, seconds) / self.time_constant)
        return tuple(
            final + (T - final) * share_left
            for T, final in zip(temperature, map(self._final, self.rise, tau), strict=True)
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


def gravity_torques(arm: Arm, gravity: Vector3) -> Torques:
    """Function that computes the torques of gravity (m/s²) on the rigid nominal arm."""
    chain = lru_cache(maxsize=4)(lambda centre: chain_of(arm.with_load_at(centre)))
    return lambda q, payload, centre: joint_torques(chain(centre), gravity, q, payload)


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

    def cooling_time(self, servo: int, limit: float) -> float:
        """Time (s) until a servo without pulses is below a limit (degC)."""
        model = self.model
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

    def check_bearable(self, tau: Sequence[float], seconds: float) -> None:
        """Raises `RequestError` if a servo would be too hot within so many seconds of torques (N m, per servo)."""
        limit, model = self.model.limits[ThermalLevel.TOO_HOT - 1], self.model
        for name, torque, rise, T in zip(self._names, tau, model.rise, self.temperature, strict=True):
            seconds_left = model.seconds_to(limit, T, torque, rise)
            if seconds_left < seconds:
                held = f"{name} would hold {abs(torque):.2f} Nm"
                text = f"{held}, and be too hot in {seconds_left:.0f} s: no load for this arm"
                raise RequestError("too_heavy", text, servo=name, seconds=seconds_left)

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
