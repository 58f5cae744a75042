"""Identity of the daemon that a session talks to, by the boot id that all of its messages carry.

The boot id is public: it tells another daemon's messages and old ones apart, and no forger who copies it. Those are
kept out by certificates and access control (config/zenoh).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import msgpack
import zenoh

from lrm_math.errors import LrmError
from lrmd.messages.bounds import ANY_MESSAGE, excess

BOOT_ID = r"[0-9A-Za-z]{1,64}"


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
