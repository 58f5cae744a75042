"""A file descriptor that goes along when a process is spawned."""

from __future__ import annotations

from dataclasses import dataclass
from multiprocessing import reduction
from typing import Any


@dataclass(frozen=True)
class SharedFd:
    """A descriptor by its number in this process. Pickled for a child that is being spawned, it is inherited."""

    number: int

    def __reduce__(self) -> tuple[Any, ...]:
        return _inherited, (reduction.DupFd(self.number),)


def _inherited(duplicate: Any) -> SharedFd:
    return SharedFd(duplicate.detach())
