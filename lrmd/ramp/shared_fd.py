"""A file descriptor inherited by a spawned process."""

from __future__ import annotations

from dataclasses import dataclass
from multiprocessing import reduction
from typing import Any


@dataclass(frozen=True)
class SharedFd:
    """A descriptor number of this process; pickling it for a child that is being spawned duplicates it there."""

    number: int

    def __reduce__(self) -> tuple[Any, ...]:
        return _inherited, (reduction.DupFd(self.number),)


def _inherited(duplicate: Any) -> SharedFd:
    return SharedFd(duplicate.detach())
