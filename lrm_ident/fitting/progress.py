"""Progress callbacks of long computations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import monotonic

Progress = Callable[[str, int, int], object]
"""Callback (what, done, of): what is being done, and how many of its parts are done; `of` is 0 if not known."""
OnProgress = Callable[[int, int], object]
"""Callback (done, of) after each part of one computation."""


def silent(*_: object) -> None:
    """Does nothing, as a `Progress` or an `OnProgress`."""


@dataclass(frozen=True)
class TimeOfParts:
    """Time of a work of equal parts, of which `at_once` run in parallel, learned from those that are done.

    `begun`: when it began, s of the monotonic clock.
    """

    at_once: int = 1
    begun: float = field(default_factory=monotonic)

    def expected(self, done: int, of: int, now: float | None = None) -> float:
        """s of the whole work; before a part is done what has passed, which is a lower bound. `now`: as `begun`."""
        passed = (monotonic() if now is None else now) - self.begun
        return passed * self._rounds(of) / self._rounds(done) if done else passed

    def left(self, done: int, of: int, now: float | None = None) -> float:
        """s until the whole work is done, where a part is."""
        return max(self.expected(done, of, now) - self.expected(of, of, now), 0.0)

    def _rounds(self, parts: int) -> int:
        return -(-parts // self.at_once)
