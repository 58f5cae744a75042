"""A tracker whose datagrams come on a zenoh key, through the session with the rover."""

from __future__ import annotations

import threading
from typing import Self

from lrm_ident.measuring.tracker.dtrack import parse_dtrack
from lrm_ident.measuring.tracker.frames import TrackerFrame
from lrmd.client import Rover

MOST = 100_000
"""Frames that are kept of one rest."""


class ZenohTracker:
    """Listens on a key. What is no frame is counted in `garbage`, and otherwise ignored."""

    def __init__(self, rover: Rover, key: str) -> None:
        self.garbage = 0
        self._frames: list[TrackerFrame] = []
        self._subscriber = rover.listen(key, self._received)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]

    def frames(self, seconds: float) -> list[TrackerFrame]:
        """See `Tracker`."""
        self._frames = []
        threading.Event().wait(seconds)
        return list(self._frames)

    def _received(self, data: bytes) -> None:
        frame = parse_dtrack(data)
        if frame is None:
            self.garbage += 1
        elif len(self._frames) < MOST:
            self._frames.append(frame)
