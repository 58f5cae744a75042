"""Ties of a child process to its parent: it ends with it, and inherits file descriptors."""

from __future__ import annotations

import ctypes
import signal
from dataclasses import dataclass
from multiprocessing import reduction
from typing import Any

PR_SET_PDEATHSIG = 1


def die_with_parent() -> None:
    """Asks the kernel to end this process when its parent ends: an orphan would keep the port."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


@dataclass(frozen=True)
class SharedFd:
    """A descriptor number of this process; pickling it for a child that is being spawned duplicates it there."""

    number: int

    def __reduce__(self) -> tuple[Any, ...]:
        return _inherited, (reduction.DupFd(self.number),)


def _inherited(duplicate: Any) -> SharedFd:
    return SharedFd(duplicate.detach())
