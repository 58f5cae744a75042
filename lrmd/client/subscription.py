"""Subscription to one daemon's messages: those of another start, and old ones, are not delivered."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress

from lrm_math.errors import LrmError
from lrmd.client.identity import Daemon, origin_of

PAUSE_S = 1.0
"""s between two questions who the daemon is."""


class Subscription:
    """Delivers payloads to `callback` that the daemon sent, in the order in which it wrote them.

    `daemon`: the one that is known. A message that is not delivered is a reason to ask again who that is, by `confirm`:
    when the daemon was restarted, or the messages before were forged, those that follow are delivered.
    """

    def __init__(
        self, callback: Callable[[bytes], None], daemon: Callable[[], Daemon | None], confirm: Callable[[], Daemon]
    ) -> None:
        self._callback, self._daemon, self._confirm = callback, daemon, confirm
        self._confirmed = self._newest = 0
        self._asking = threading.Lock()

    def take(self, key: str, data: bytes) -> None:
        """Delivers one message that came on a key, or leaves it."""
        origin, daemon = origin_of(data), self._daemon()
        if origin is None or daemon is None or "*" in key:
            return
        if daemon.confirmed != self._confirmed:
            self._confirmed, self._newest = daemon.confirmed, min(self._newest, daemon.confirmed)
        if origin.boot_id == daemon.boot_id and origin.t_mono_ns > self._newest:
            self._newest = origin.t_mono_ns
            self._callback(data)
        elif self._asking.acquire(blocking=False):
            threading.Thread(target=self._ask, daemon=True).start()

    def _ask(self) -> None:
        """Asks, in a thread of its own: zenoh's must not wait for a reply."""
        with suppress(LrmError):
            self._confirm()
        threading.Event().wait(PAUSE_S)
        self._asking.release()
