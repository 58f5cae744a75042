"""Identity of the daemon that a session talks to, by the boot id that all of its messages carry.

The boot id is public: it tells another daemon's messages and old ones apart, and no forger who copies it. Those are
kept out by certificates and access control (config/zenoh).

A subscription delivers none of another start, and no old ones.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass

import msgpack
import zenoh

from lrm_math.errors import LrmError
from lrmd.messages.bounds import ANY_MESSAGE, excess

BOOT_ID = r"[0-9A-Za-z]{1,64}"
PAUSE_S = 1.0
"""s between two questions who the daemon is."""


class SeveralDaemons(LrmError):
    """Several programs answered for one robot, and which of them is its daemon cannot be told."""


class DaemonRestarted(LrmError):
    """Another start of the daemon than the one that gave the lease; `before` and `now` are the boot ids."""

    def __init__(self, robot: str, before: str, now: str) -> None:
        self.before, self.now = before, now
        super().__init__(
            f"the daemon of {robot} was restarted (boot id {before}, now {now}): the lease is lost, and the outputs "
            "are off or not adopted yet; look at its mode, and take the lease anew"
        )


@dataclass(frozen=True)
class Origin:
    """Origin of a message, as it says itself: which start of it, and when (monotonic ns, 0 if unsaid)."""

    boot_id: str
    t_mono_ns: int


@dataclass(frozen=True)
class Daemon:
    """One start of a daemon, as a client knows it; monotonic ns of the daemon's computer.

    `confirmed`: when its `info` said who it is. `seen`: of its newest reply, or `confirmed`.
    """

    boot_id: str
    confirmed: int
    seen: int

    def wrote(self, origin: Origin) -> bool:
        """Whether a reply comes from this start of it, and is newer than all that came before it was asked for."""
        return origin.boot_id == self.boot_id and not 0 < origin.t_mono_ns <= self.seen


@dataclass(frozen=True)
class QueryAnswer:
    """One program's reply to a query; `refused`: it is an error reply. `origin`: None if it says nothing of that."""

    data: bytes
    refused: bool
    origin: Origin | None

    @classmethod
    def of(cls, reply: zenoh.Reply, key: str) -> QueryAnswer:
        """The reply to a query of this key; one of another key says nothing."""
        if reply.ok is None:
            data = b"" if reply.err is None else reply.err.payload.to_bytes()
            return cls(data, True, origin_of(data))
        data = reply.ok.payload.to_bytes()
        return cls(data, False, origin_of(data) if str(reply.ok.key_expr) == key else None)


def origin_of(data: bytes) -> Origin | None:
    """Origin of a packed message; None if it is no message of a daemon."""
    if not 0 < len(data) <= ANY_MESSAGE.size or excess(data, ANY_MESSAGE) is not None:
        return None
    try:
        content = msgpack.unpackb(data)
    except (ValueError, msgpack.UnpackException):
        return None
    if not isinstance(content, dict):
        return None
    boot_id, written = content.get("boot_id"), content.get("t_mono_ns", 0)
    if isinstance(boot_id, str) and re.fullmatch(BOOT_ID, boot_id) and isinstance(written, int):
        return Origin(boot_id, written)
    return None


def boot_ids(answers: Iterable[QueryAnswer]) -> list[str]:
    """Boot ids that answers carry, each once."""
    return sorted({answer.origin.boot_id for answer in answers if answer.origin is not None})


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
            threading.Thread(target=self._confirm_and_pause, daemon=True).start()

    def _confirm_and_pause(self) -> None:
        """Confirms who the daemon is, in a thread of its own: zenoh's must not wait for a reply."""
        with suppress(LrmError):
            self._confirm()
        threading.Event().wait(PAUSE_S)
        self._asking.release()
