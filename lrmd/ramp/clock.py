"""The ramp's monotonic clock with absolute-deadline sleep; it may run faster than real time with a simulated board."""

from __future__ import annotations

import select
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class MonotonicClock:
    """CLOCK_MONOTONIC scaled by `speed`, which differs from 1 with a simulated board only."""

    speed: float = 1.0

    def now(self) -> int:
        """Current time, ns."""
        return int(time.monotonic_ns() * self.speed) if self.speed != 1.0 else time.monotonic_ns()

    def sleep_until(self, due: int) -> None:
        """Sleeps until `due` (ns). Python sleeps to an absolute time of the same clock, so errors do not accumulate."""
        rest = (due - self.now()) / self.speed
        if rest > 0:
            time.sleep(rest * 1e-9)

    def wait_for(self, descriptor: int, due: int) -> None:
        """Sleeps until `due` (ns), or until there is something to read from the descriptor."""
        rest = (due - self.now()) / self.speed
        if rest > 0:
            select.select([descriptor], [], [], rest * 1e-9)
