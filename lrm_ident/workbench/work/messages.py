"""Messages of the work process to the page: progress, notices, results, the end of a task."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class WorkProgress:
    """Progress of the work; `of` is 0 as long as its length is not known."""

    what: str
    done: int = 0
    of: int = 0


@dataclass(frozen=True)
class WorkNotice:
    """Notice of a file for a person."""

    words: str


@dataclass(frozen=True)
class WorkResult:
    """A result of a task, which may have more."""

    value: Any


@dataclass(frozen=True)
class WorkDone:
    """The task is done."""


@dataclass(frozen=True)
class WorkFailure:
    """Reason why a task ended without a result, in one line."""

    words: str


WorkMessage = WorkProgress | WorkNotice | WorkResult | WorkDone | WorkFailure
Send = Callable[[WorkMessage], None]
