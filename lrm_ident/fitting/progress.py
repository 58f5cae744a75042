"""Progress of long computations: one protocol, and its form where what is done has a name already."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, int, int], object]
"""Called with what is being done, how many parts of it are done, and of how many; 0 if that is not known."""
OnProgress = Callable[[int, int], object]
"""Called with (done, of) after each part: a `Progress` of one thing."""


def silent(done: int, of: int) -> None:
    """A callback that does nothing."""


def unheard(what: str, done: int, of: int) -> None:
    """A progress that nobody sees."""
