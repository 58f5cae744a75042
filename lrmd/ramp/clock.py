"""The ramp's monotonic clock with absolute-deadline sleep; it may run faster than real time with a simulated board."""

from __future__ import annotations

import select
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class MonotonicClock:
    """CLOCK_MONOTONIC since `start` (ns), scaled by `speed`, which differs from 1 with a simulated board only."""

    speed: float = 1.0
    start: int = 0

    def now(self) -> int:
        """Current time, ns."""
        passed = time.monotonic_ns() - self.start
        return int(passed * self.speed) if self.speed != 1.0 else passed

    def seconds_to(self, due: int) -> float:
        """Real time (s) until `due` (ns); 0 if that is over."""
        return max(0.0, (due - self.now()) / self.speed * 1e-9)

    def sleep_until(self, due: int) -> None:
        """Sleeps until `due` (ns). Python sleeps to an absolute time of the same clock, so errors do not accumulate."""
        time.sleep(self.seconds_to(due))

    def wait_for(self, descriptor: int, due: int) -> None:
        """Sleeps until `due` (ns), or until there is something to read from the descriptor."""
        select.select([descriptor], [], [], self.seconds_to(due))
