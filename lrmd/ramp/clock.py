"""The monotonic clock of the ramp, and how it waits. A simulated board may live in faster time."""

from __future__ import annotations

import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Clock:
    """Monotonic time that runs `speed` times as fast as the system's; other than 1 with a simulated board only."""

    speed: float = 1.0

    def now(self) -> int:
        """Now, in ns."""
        return int(time.monotonic_ns() * self.speed) if self.speed != 1.0 else time.monotonic_ns()

    def sleep_until(self, due: int) -> None:
        """Waits for a moment (ns). Python's sleep waits for an absolute time of the same clock, so nothing adds up."""
        rest = (due - self.now()) / self.speed
        if rest > 0:
            time.sleep(rest * 1e-9)
