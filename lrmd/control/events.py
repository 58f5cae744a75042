"""What the daemon's core gives out beside its orders: what happened, what is wrong, what a request led to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from lrmd.control.lease import Lease

Level = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class Happening:
    """Something worth telling: an event on zenoh and a line in the log."""

    code: str
    level: Level
    text: str
    detail: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Fault:
    """A fault that was not reset yet; `since`, monotonic ns."""

    code: str
    text: str
    since: int


@dataclass(frozen=True)
class Done:
    """What a request led to: seconds until it is done, where that is known; the lease it gave."""

    seconds: float | None = None
    lease: Lease | None = None
