"""What a program still prints, and what it says, where an error of the system ends a command."""

from __future__ import annotations

import os
import sys
from contextlib import suppress


def flush_or_discard() -> None:
    """Writes what is in the buffer of stdout; if that fails (a full disk, a reader that has gone), sends it nowhere.

    Otherwise it would fail again at the end of the process.
    """
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError):  # no stream of the system
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def os_error_words(error: OSError) -> str:
    """What is wrong, after the name of the file where the error has one; stdout is flushed or discarded before."""
    flush_or_discard()
    words = error.strerror or str(error) or type(error).__name__
    return words if error.filename is None else f"{error.filename}: {words}"
