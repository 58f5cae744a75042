"""Presence of daemons on the network, by zenoh's liveliness tokens: two of one name would both answer for the arm.

And readiness of the own ik process: it counts once a query has reached it through the router and was answered.
"""

from __future__ import annotations

import threading

import zenoh

from lrmd.config import SECOND
from lrmd.messages.codec import pack
from lrmd.messages.kinematics import CANCEL, CancelRequest
from lrmd.messages.zenoh_session import key

RETRY, TIMEOUT_S = SECOND // 20, 1.0
"""ns between two probes, and s until one is given up."""


class Presence:
    """Declares this daemon's token, with its `boot_id`, and watches those of others with its name."""

    def __init__(self, session: zenoh.Session, robot: str, boot_id: str) -> None:
        self._boot_id, self._lock, self._others = boot_id, threading.Lock(), frozenset[str]()
        tokens = session.liveliness()
        tokens.declare_subscriber(key(robot, "alive/boot/*"), self._seen, history=True)
        self._token = tokens.declare_token(key(robot, f"alive/boot/{boot_id}"))

    @property
    def others(self) -> frozenset[str]:
        """`boot_id` of every other daemon of this name that is reachable now."""
        return self._others

    def _seen(self, sample: zenoh.Sample) -> None:
        boot_id = str(sample.key_expr).rpartition("/")[2][:64]
        with self._lock:
            here = sample.kind == zenoh.SampleKind.PUT and boot_id != self._boot_id
            self._others = self._others | {boot_id} if here else self._others - {boot_id}


class IkProbe:
    """Sends queries that change nothing until one is answered."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self._session, self._key = session, key(robot, CANCEL)
        self._data = pack(CancelRequest(id="readiness"))
        self._asked_at = -RETRY
        self.answered = False

    def query(self, now: int) -> None:
        """Sends the next query, if it is due at `now` (ns)."""
        if not self.answered and now - self._asked_at >= RETRY:
            self._asked_at = now
            self._session.get(self._key, self._on_reply, payload=self._data, timeout=TIMEOUT_S)

    def _on_reply(self, reply: zenoh.Reply) -> None:
        self.answered = self.answered or reply.ok is not None
