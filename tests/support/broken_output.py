"""Descriptors that take no more text: of a closed pipe, of a pipe that nobody reads, of a file on a full disk."""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress


def closed_pipe() -> int:
    """The end of a pipe whose reader is gone."""
    reading, writing = os.pipe()
    os.close(reading)
    return writing


def unread_pipe() -> int:
    """The end of a full pipe that this process could read, and does not."""
    _, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, 4096)
    os.set_blocking(writing, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writing, b"x")
    os.set_blocking(writing, True)
    return writing


def full_disk_file() -> int:
    """A file that says that its disk is full."""
    return os.open("/dev/full", os.O_WRONLY)


BROKEN_OUTPUTS = (closed_pipe, unread_pipe, full_disk_file)
