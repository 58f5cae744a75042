"""Times at which the state is saved: on change, at least once a minute, and during a motion only at an interval."""

from __future__ import annotations

INTERVAL = 60_000_000_000
"""ns after which it is saved without a change too."""


class SaveSchedule:
    """`moving_interval`: ns between two states that are saved during a motion."""

    def __init__(self, moving_interval: int) -> None:
        self._moving_interval = moving_interval
        self._at = 0
        self._state: tuple[object, ...] = ()
        self._moving = False

    def due(self, state: tuple[object, ...], moving: bool, now: int) -> bool:
        """Whether to save at `now` (ns); if so, it is the saved state from now on."""
        wait = self._moving_interval if moving and self._moving else 0
        changed = state != self._state and now - self._at >= wait
        if not changed and now - self._at <= INTERVAL:
            return False
        self._at, self._state, self._moving = now, state, moving
        return True
