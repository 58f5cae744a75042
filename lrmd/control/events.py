"""Outputs of the controller beside its orders: events, latched faults and results of requests."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from lrmd.control.lease import Lease

Level = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class ControllerEvent:
    """An event: published on zenoh and logged."""

    code: str
    level: Level
    text: str
    detail: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RequestResult:
    """Result of a request: expected duration (s) where it is known, and the lease it granted."""

    seconds: float | None = None
    lease: Lease | None = None
