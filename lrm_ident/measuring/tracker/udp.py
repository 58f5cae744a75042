"""A tracker that sends DTrack's ASCII datagrams to a UDP port."""

from __future__ import annotations

import socket
import time
from contextlib import AbstractContextManager

from lrm_ident.measuring.tracker.dtrack import LONGEST, parse_dtrack
from lrm_ident.measuring.tracker.frames import TrackerFrame
from lrm_math.errors import LrmError

FLOOD = 100_000
"""Datagrams of one rest after which it ends: a port that is flooded must not hold the campaign."""


class UdpTracker(AbstractContextManager["UdpTracker"]):
    """Listens on a port of an address. What is no frame is counted in `garbage`, and otherwise ignored."""

    def __init__(self, host: str, port: int) -> None:
        """Raises `LrmError` if the port cannot be had."""
        self.garbage = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise LrmError(f"tracker {host}:{port}: cannot listen there ({error.strerror})") from None

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    @property
    def port(self) -> int:
        """The port, also where 0 was requested."""
        return int(self._socket.getsockname()[1])

    def frames(self, seconds: float) -> list[TrackerFrame]:
        """See `Tracker`."""
        self._drain()
        end = time.monotonic() + seconds
        found: list[TrackerFrame] = []
        for _ in range(FLOOD):
            self._socket.settimeout(max(0.0, end - time.monotonic()))  # 0: what came, and is read late
            try:
                frame = parse_dtrack(self._socket.recv(LONGEST))
            except (TimeoutError, BlockingIOError):
                break
            except OSError:
                continue
            if frame is None:
                self.garbage += 1
            else:
                found.append(frame)
        return found

    def _drain(self) -> None:
        """Takes what arrived before, without looking at it."""
        self._socket.setblocking(False)
        for _ in range(FLOOD):
            try:
                self._socket.recv(LONGEST)
            except BlockingIOError:
                return
            except OSError:
                continue
