"""One daemon per state directory: a second one would store a pose of its own, under which the arm is armed later."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from lrm_math.errors import FileError


@contextmanager
def sole_user(folder: Path) -> Iterator[None]:
    """Context in which no other daemon uses the folder, which is made; the kernel ends it with the process.

    Raises `FileError` if another one does. A folder that cannot be used at all is reported by whoever saves in it.
    """
    descriptor = None
    with suppress(OSError):
        folder.mkdir(mode=0o750, parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY)
    try:
        if descriptor is not None:
            _lock(descriptor, folder)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _lock(descriptor: int, folder: Path) -> None:
    """Locks an open folder, if its file system can. Raises `FileError` if it is locked."""
    with suppress(OSError):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            text = "is used by another lrmd: end that one, or give this one another directory in [state]"
            raise FileError(folder, "", text) from None
