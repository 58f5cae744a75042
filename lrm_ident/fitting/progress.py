"""Progress callbacks of long computations."""

from __future__ import annotations

from collections.abc import Callable

OnProgress = Callable[[int, int], None]
"""Called with (done, of) after each part."""


def silent(done: int, of: int) -> None:
    """A callback that does nothing."""
