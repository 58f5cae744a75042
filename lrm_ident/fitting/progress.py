"""Progress callbacks of long computations."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], object]
"""Callback (what, done, of): what is being done, and how many of its parts are done; `of` is 0 if not known."""
OnProgress = Callable[[int, int], object]
"""Callback (done, of) after each part of one computation."""


def silent(*_: object) -> None:
    """Does nothing, as a `Progress` or an `OnProgress`."""
