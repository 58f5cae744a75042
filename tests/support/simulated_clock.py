"""Time without waiting."""

from __future__ import annotations


class SimulatedClock:
    """Time that passes by sleeping. `t`: s."""

    t = 0.0

    def now(self) -> float:
        """See `Clock`."""
        return self.t

    def sleep(self, seconds: float) -> None:
        """See `Clock`."""
        self.t += max(0.0, seconds)
