"""A file of ART DTrack's ASCII output, as its datagrams stand one after the other; `measuring.tracker.dtrack` has their
form. Targets are bodies named by their numbers.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from lrm_ident.measuring.recordings.take import BodyTrack, RecordedTake
from lrm_ident.measuring.tracker.dtrack import parse_dtrack
from lrm_ident.measuring.tracker.frames import TrackerFrame
from lrm_math.errors import FileError

FRAME = re.compile(r"^fr[ \t]", re.MULTILINE)
"""Begin of a frame."""


def is_dtrack(text: str) -> bool:
    """Whether a file's text begins as DTrack's output does."""
    return FRAME.match(text.lstrip()) is not None


def dtrack_take(path: Path, text: str) -> RecordedTake:
    """All targets of a recording; NaN where one was not seen.

    The last frame may be cut short. Raises `FileError`: another one cannot be read, or no target was ever seen.
    """
    starts = [*(frame.start() for frame in FRAME.finditer(text)), len(text)]
    frames: list[TrackerFrame] = []
    for number, (begin, end) in enumerate(pairwise(starts)):
        frame = parse_dtrack(text[begin:end].encode("ascii", "replace"))
        if frame is not None:
            frames.append(frame)
        elif number < len(starts) - 2:
            line = text.count("\n", 0, begin) + 1
            raise FileError(path, f"line {line}", "a frame without fr, ts or 6d that can be read", WITH)
    numbers = sorted({number for frame in frames for number in frame.targets})
    if not numbers:
        raise FileError(path, "", "no target was seen in any frame", WITH)
    bodies = {str(number): _track(frames, number) for number in numbers}
    return RecordedTake(path, np.array([frame.t for frame in frames]), bodies)


WITH = "DTrack's output with 6d and ts switched on"


def _track(frames: Sequence[TrackerFrame], number: int) -> BodyTrack:
    position, rotation = np.full((len(frames), 3), np.nan), np.full((len(frames), 3, 3), np.nan)
    for row, frame in enumerate(frames):
        if (pose := frame.targets.get(number)) is not None:
            position[row], rotation[row] = pose.position, pose.rotation
    return BodyTrack(position, rotation)
