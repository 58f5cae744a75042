"""Structured log: one JSON object per line on standard error, for systemd's journal.

Written by a thread of its own: a terminal that is stopped or closed, a pipe that nobody reads, a disk that is full cost
lines, and hold nobody up.
"""

from __future__ import annotations

import atexit
import logging
import os
import sys
import threading
from contextlib import suppress
from queue import Full, Queue
from typing import TextIO, cast

LINES = 1000
"""Lines that wait for a slow reader; later ones are dropped."""
LAST_S = 1.0
"""s that the end of the process waits for its last lines to be written."""


class BackgroundFile:
    """Text file that writes to a descriptor without waiting for it; what cannot be written is dropped.

    Without a descriptor it is standard error, or nothing where the daemon was started without one: another file may
    have its number by now.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        if descriptor is None:
            descriptor = os.open(os.devnull, os.O_WRONLY) if sys.stderr is None else sys.stderr.fileno()
        self._descriptor = descriptor
        self._waiting: Queue[str | None] = Queue(LINES)
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()
        atexit.register(self.close)

    def write(self, text: str) -> None:
        """Takes a text, or drops it if too many wait."""
        with suppress(Full):
            self._waiting.put_nowait(text)

    def flush(self) -> None:
        """Does nothing."""

    def close(self) -> None:
        """Waits until all is written, twice `LAST_S` at most."""
        with suppress(Full):
            self._waiting.put(None, timeout=LAST_S)
        self._thread.join(LAST_S)

    def _run(self) -> None:
        while (text := self._waiting.get()) is not None:
            with suppress(OSError):
                os.write(self._descriptor, text.encode(errors="replace"))


def set_up(level: str = "info") -> None:
    """Configures structlog: JSON lines with time, level and event."""
    import structlog  # the router process, which writes two lines at most, does without

    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            structlog.processors.JSONRenderer(),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.getLevelNamesMapping()[level.upper()]),
        logger_factory=structlog.WriteLoggerFactory(cast(TextIO, BackgroundFile())),
        cache_logger_on_first_use=True,
    )
