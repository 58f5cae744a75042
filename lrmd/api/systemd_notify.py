"""systemd's notification socket (sd_notify), which is one datagram."""

from __future__ import annotations

import contextlib
import os
import socket

PATIENCE = 0.05
"""s: the socket of a systemd that does not read fills up, and the daemon must not stand still with it."""


def notify(message: str) -> bool:
    """Tells systemd, if there is one to tell: `READY=1`, `WATCHDOG=1`, `STATUS=…`, `STOPPING=1`."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    target = "\0" + address[1:] if address.startswith("@") else address
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as s:
        s.settimeout(PATIENCE)
        s.sendto(message.encode(), target)
        return True
    return False


def watchdog_s() -> float | None:
    """How often systemd wants a sign of life (s), None if it does not."""
    usec = os.environ.get("WATCHDOG_USEC", "")
    return int(usec) / 1e6 if usec.isdigit() else None
