"""Ties of a child process to its parent: it ends with it, and inherits file descriptors."""

from __future__ import annotations

import ctypes
import signal
from dataclasses import dataclass
from multiprocessing import reduction
from typing import Any

PR_SET_PDEATHSIG = 1


def die_with_parent(number: int = signal.SIGKILL) -> None:
    """Asks the kernel to send this process a signal when its parent ends: an orphan would keep the port.

    SIGKILL, unless the process has something to put in order: it works at once, and on a stopped process, too.
    """
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, number)


@dataclass(frozen=True)
class SharedFd:
    """A descriptor number of this process; pickling it for a child that is being spawned duplicates it there."""

    number: int

    def __reduce__(self) -> tuple[Any, ...]:
        return _inherited, (reduction.DupFd(self.number),)


def _inherited(duplicate: Any) -> SharedFd:
    return SharedFd(duplicate.detach())
