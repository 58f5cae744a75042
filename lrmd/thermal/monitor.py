"""How hot the servos are over time, and what became hotter or cooler than it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lrmd.config import Config
from lrmd.errors import Refused
from lrmd.persistence.state_file import Saved
from lrmd.thermal.model import Heat, Thermal

SECOND = 1_000_000_000


@dataclass(frozen=True)
class Change:
    """Servo number `servo` went from one level of heat to another."""

    servo: int
    before: Heat
    after: Heat


class HeatWatch:
    """`temperature` (degC) and `tau` (N m) per servo, as of the last `update`."""

    def __init__(self, config: Config, stored: Saved | None, now: int, wall: int) -> None:
        self.model = Thermal.of(config)
        self._names = config.names
        self._at = now
        self.tau: tuple[float, ...] = (0.0,) * len(config.servos)
        self.temperature = self._cooled(stored, wall)

    def _cooled(self, stored: Saved | None, wall: int) -> tuple[float, ...]:
        """What they were when stored, cooled for the time since."""
        cold = self.model.cold()
        if stored is None:
            return cold
        was = tuple(stored.temperature_c.get(n, T) for n, T in zip(self._names, cold, strict=True))
        return self.model.after((wall - stored.saved_wall_ns) / SECOND, was, (0.0,) * len(cold))

    def due(self, now: int) -> bool:
        """Whether a second has passed since the last update."""
        return now - self._at >= SECOND

    @property
    def hot_in(self) -> list[float]:
        """Seconds until each servo is hot, if the torques stay as they are; infinite if never."""
        limit, model = self.model.limits[Heat.HOT - 1], self.model
        return [
            model.seconds_to(limit, T, tau, rise)
            for T, tau, rise in zip(self.temperature, self.tau, model.rise, strict=True)
        ]

    def update(self, now: int, tau: Sequence[float]) -> list[Change]:
        """Goes on to `now` (ns) with these torques (N m), 0 for servos without pulses."""
        seconds, self._at = (now - self._at) / SECOND, now
        before = [self.model.heat(T) for T in self.temperature]
        self.tau = tuple(tau)
        self.temperature = self.model.after(seconds, self.temperature, self.tau)
        after = [self.model.heat(T) for T in self.temperature]
        changes = [Change(i, old, new) for i, (old, new) in enumerate(zip(before, after, strict=True))]
        return [change for change in changes if change.before is not change.after]

    def check(self, now: Sequence[float], then: Sequence[float]) -> None:
        """Raises `Refused` if a warm servo would carry more (N m, per servo) than it does now."""
        for name, before, after, T in zip(self._names, now, then, self.temperature, strict=True):
            if self.model.heat(T) >= Heat.WARM and abs(after) > abs(before) + 1e-9:
                raise Refused(
                    "too_warm",
                    f"{name} is at {T:.0f} degC and would hold {abs(after):.2f} instead of {abs(before):.2f} Nm; "
                    "go where it carries less, or let it cool",
                    retryable=True, servo=name,
                )  # fmt: skip
