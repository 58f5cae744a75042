"""Trackers by name, as `--tracker` takes them."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TypeAlias

from lrm_ident.measuring.tracker.dtrack import UdpTracker
from lrm_ident.measuring.tracker.frames import TargetNumbers, Tracker
from lrm_ident.measuring.tracker.growing_csv import GrowingCsv
from lrm_math.errors import LrmError

FORMS = "dtrack:PORT, dtrack:ADDRESS:PORT, csv:FILE, camera:0,SESSION or zenoh:KEY"
IN_ARM_FRAME = ("csv:", "camera:")
"""Beginnings of those that say where the tip is in the arm's frame, and need no target at its base."""
OpenTracker: TypeAlias = AbstractContextManager[Tracker]
TrackerOpener: TypeAlias = Callable[[TargetNumbers], OpenTracker]


def tracker_named(text: str) -> TrackerOpener:
    """What opens the tracker of `dtrack:5000`, `dtrack:0.0.0.0:5000`, `csv:FILE` or `camera:0,SESSION`.

    Raises `LrmError`: no such form, or a file that it names cannot be read.
    """
    kind, _, rest = text.partition(":")
    if kind == "dtrack" and (place := re.fullmatch(r"(?:([\w.-]+):)?(\d{1,5})", rest)):
        host, port = place[1] or "127.0.0.1", int(place[2])
        if port < 65_536:
            return lambda _: UdpTracker(host, port)
    if kind == "csv" and rest:
        path = Path(rest)
        with GrowingCsv(path, 0):
            return lambda numbers: GrowingCsv(path, numbers.tool)
    if kind == "camera" and rest:
        from lrm_ident.measuring.camera.camera_tracker import camera_named  # OpenCV, which no other tracker needs

        camera = camera_named(rest)
        return lambda numbers: camera(numbers.tool)
    raise LrmError(f"--tracker {text}: should be {FORMS}")


def open_tracker(text: str, numbers: TargetNumbers) -> OpenTracker:
    """The tracker that `tracker_named` opens. Raises `LrmError`."""
    return tracker_named(text)(numbers)
