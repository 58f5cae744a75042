"""Presence of daemons on the network, by zenoh's liveliness tokens: two of one name would both answer for the arm."""

from __future__ import annotations

import threading

import zenoh

from lrmd.messages.zenoh_session import key


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
