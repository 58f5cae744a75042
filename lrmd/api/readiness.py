"""Readiness of the ik process: it counts once a query has reached it through the router and was answered."""

from __future__ import annotations

import zenoh

from lrmd.config import SECOND
from lrmd.messages.codec import pack
from lrmd.messages.kinematics import CancelRequest
from lrmd.messages.zenoh_session import key

RETRY, TIMEOUT_S = SECOND // 20, 1.0
"""ns between two probes, and s until one is given up."""


class IkProbe:
    """Sends queries that change nothing until one is answered."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self._session, self._key = session, key(robot, "rpc/cancel")
        self._data = pack(CancelRequest(id="readiness"))
        self._asked_at = -RETRY
        self.answered = False

    def ask(self, now: int) -> None:
        """Sends the next query, if it is due at `now` (ns)."""
        if not self.answered and now - self._asked_at >= RETRY:
            self._asked_at = now
            self._session.get(self._key, self._on_reply, payload=self._data, timeout=TIMEOUT_S)

    def _on_reply(self, reply: zenoh.Reply) -> None:
        self.answered = self.answered or reply.ok is not None
