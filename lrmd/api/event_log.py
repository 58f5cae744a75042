"""Events in bounded numbers: a rate limit and a ring per code, so that no kind of event displaces the others."""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass, replace
from functools import partial

from lrmd.config import SECOND
from lrmd.control.state import ControllerEvent

BURST, WINDOW = 10, SECOND
"""Events of one code that pass within a window (ns) which begins with the first of them."""
KEPT_EVENTS = 500
"""Events kept of each code."""


@dataclass
class _Window:
    start: int
    count: int = 0
    last: ControllerEvent | None = None


class EventThrottle:
    """Passes the first `BURST` events of a code in a `WINDOW`; of the others the last, at its end, with their count."""

    def __init__(self) -> None:
        self._windows: dict[str, _Window] = {}

    def passes(self, event: ControllerEvent, now: int) -> bool:
        """Whether an event may be published at `now` (ns); if not, it is counted."""
        window = self._windows.setdefault(event.code, _Window(now))
        window.count += 1
        if window.count > BURST:
            window.last = event
        return window.last is None

    def due(self, now: int) -> list[ControllerEvent]:
        """The last event of each window that has ended, if it was not passed; with the `count` of those like it."""
        ended = [code for code, window in self._windows.items() if now - window.start >= WINDOW]
        windows = [self._windows.pop(code) for code in ended]
        return [_with_count(w.last, w.count - BURST) for w in windows if w.last is not None]


def _with_count(last: ControllerEvent, count: int) -> ControllerEvent:
    if count == 1:
        return last
    text = f"{last.text} (the last of {count} in {WINDOW // SECOND} s that are not listed)"
    return replace(last, text=text, detail={**last.detail, "count": count})


class EventRing:
    """The last `KEPT_EVENTS` packed events of each code."""

    def __init__(self) -> None:
        ring = partial(deque[tuple[int, bytes]], maxlen=KEPT_EVENTS)
        self._rings: defaultdict[str, deque[tuple[int, bytes]]] = defaultdict(ring)
        self._number = 0

    def add(self, code: str, data: bytes) -> None:
        """Keeps a packed event; the oldest of its code may go."""
        self._number += 1
        self._rings[code].append((self._number, data))

    def all(self) -> list[bytes]:
        """The kept events of all codes, oldest first."""
        return [data for _, data in sorted(entry for ring in self._rings.values() for entry in ring)]
