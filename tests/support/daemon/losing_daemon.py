"""A daemon in memory that loses replies, replies late, or gets requests late."""

from __future__ import annotations

from math import inf
from typing import Any

from tests.support.daemon.in_memory_daemon import SimulatedDaemon
from tests.support.daemon.in_memory_zenoh import FakeReply, InMemoryDaemon


class LosingDaemon(InMemoryDaemon):
    """Whose replies to one request are `lost`, or come after `late` seconds; what was asked is done, or `delayed`."""

    def __init__(self, sim: SimulatedDaemon) -> None:
        super().__init__(sim)
        self.lost, self.late = "", inf
        self.delays, self.delayed = False, list[tuple[str, bytes]]()
        self._get, self.session.get = self.session.get, self._losing  # type: ignore[method-assign]

    def _losing(self, key: str, payload: bytes = b"", **more: Any) -> list[FakeReply]:
        if not self.lost or not key.endswith(self.lost) or more.get("timeout", 0.0) > self.late:
            return self._get(key, payload, **more)
        if self.delays:
            self.delayed.append((key, payload))
        else:
            self._get(key, payload, **more)
        return []

    def arrives(self) -> list[FakeReply]:
        """The delayed request arrives: its replies."""
        return self._get(*self.delayed.pop())
