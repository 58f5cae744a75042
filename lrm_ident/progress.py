"""How long work tells how far it is."""

from __future__ import annotations

from collections.abc import Callable

Tick = Callable[[int, int], None]
"""Called with (done, of) after each part."""


def silent(done: int, of: int) -> None:
    """Tells nobody."""
