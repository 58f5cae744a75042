"""The computer's clock, which notices where the computer or the program stood still."""

from __future__ import annotations

import threading
import time
import weakref

from lrm_math.errors import LrmError

AWAY_S = 10.0
"""s that a program may stand still; as long as a daemon gives an expired lease back."""
LOOK_S = 0.5
"""s between two looks at the time."""


def _time() -> float:
    """Time (s) that goes on while the computer is suspended, where there is a clock for it (Linux)."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if clock is None else time.clock_gettime(clock)


class RealClock:
    """The computer's clock.

    It raises `LrmError` where the computer was suspended or the program stopped (SIGSTOP, Ctrl-Z) since it was made,
    whatever was waited for meanwhile: who wakes it did not ask the arm to move. A daemon ends such a client's lease by
    itself. A thread looks at the time again and again, since not everything is waited for by this clock.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._seen, self._away = _time(), 0.0
        threading.Thread(target=_watch, args=(weakref.ref(self),), name="clock", daemon=True).start()

    def now(self) -> float:
        """Monotonic time (s)."""
        if (away := self.look()) > AWAY_S:
            raise LrmError(f"this computer or program stood still for {away:.0f} s; begin again where the arm may move")
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Waits; not for a negative time."""
        end = self.now() + seconds
        while (remaining := end - self.now()) > 0.0:
            time.sleep(min(remaining, LOOK_S))

    def look(self) -> float:
        """The longest time (s) between two looks so far."""
        with self._lock:
            instant = _time()
            self._away, self._seen = max(self._away, instant - self._seen), instant
            return self._away


def _watch(clock: weakref.ref[RealClock]) -> None:
    """Looks as long as somebody has the clock."""
    wait = threading.Event().wait
    while (instant := clock()) is not None:
        instant.look()
        del instant
        wait(LOOK_S)
