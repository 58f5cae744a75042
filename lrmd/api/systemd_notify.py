"""systemd's notification protocol (sd_notify): one datagram per message."""

from __future__ import annotations

import contextlib
import os
import socket

TIMEOUT = 0.05
"""s: the socket fills up if systemd does not read it, which must not block the daemon."""


def notify(message: str) -> bool:
    """Sends `READY=1`, `WATCHDOG=1`, `STATUS=…` or `STOPPING=1` to systemd; whether it was sent."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return False
    target = "\0" + address[1:] if address.startswith("@") else address
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as s:
        s.settimeout(TIMEOUT)
        s.sendto(message.encode(), target)
        return True
    return False


def watchdog_s() -> float | None:
    """systemd's watchdog timeout (s), None without one."""
    usec = os.environ.get("WATCHDOG_USEC", "")
    return int(usec) / 1e6 if usec.isdigit() else None
