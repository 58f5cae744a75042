"""The release key of a drive without a daemon: Ctrl-backslash, which the terminal sends as SIGQUIT.

It stops as Ctrl-C does: nothing more is commanded, and the arm holds where it was sent last. Only if the person says so
besides, by an option before or by a word after, the servos lose their torque, and the arm falls.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

from lrm_ident.measuring.servo_bus.servos import BusServos

WORD = "release"


class ReleaseKey(KeyboardInterrupt):
    """The release key was pressed. `released`: whether the servos have lost their torque."""

    released = False


@contextmanager
def release_key(servos: BusServos, may_release: Callable[[], bool]) -> Iterator[None]:
    """Listens to the key meanwhile, on the main thread. `may_release`: whether the person says so; the arm holds."""
    before = signal.signal(signal.SIGQUIT, _press)
    try:
        yield
    except ReleaseKey as pressed:
        signal.signal(signal.SIGQUIT, signal.SIG_IGN)  # pressed again it says nothing new
        if may_release():
            servos.release()
            pressed.released = True
        raise
    finally:
        signal.signal(signal.SIGQUIT, before)


def asked_for_release() -> bool:
    """Asks on the terminal. Anything but the word, and no terminal, is no."""
    try:
        return input(f"The arm holds. To release its torque, so that it falls, type {WORD}: ").strip() == WORD
    except (EOFError, KeyboardInterrupt):
        return False


def _press(*_: object) -> NoReturn:
    raise ReleaseKey
