"""A CSV that another program is writing: the tip in the arm's frame, one line a frame."""

from __future__ import annotations

import csv
import math
import time
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from lrm_ident.measuring.tracker.frames import TargetPose, TrackerFrame
from lrm_math.arm.arm_file import MM
from lrm_math.errors import FileError

COLUMNS = ("t_s", "x_mm", "y_mm", "z_mm")


class GrowingCsv(AbstractContextManager["GrowingCsv"]):
    """Follows the end of a file with the columns `t_s, x_mm, y_mm, z_mm`; its targets have the number `tool`.

    A line that is no frame is ignored; the last, unfinished one waits.
    """

    def __init__(self, path: Path, tool: int) -> None:
        """Raises `FileError`: no such file, or no such columns."""
        self._tool, self._line, self._part = tool, 0, ""
        try:
            self._file = path.open(encoding="utf-8", errors="replace", newline="")
        except OSError as error:
            raise FileError(path, "tracker", f"cannot be read ({error.strerror})") from None
        header = next(csv.reader([self._file.readline()]), [])
        missing = [name for name in COLUMNS if name not in header]
        if missing:
            self._file.close()
            raise FileError(path, "header", f"missing column {missing[0]}", f"required: {', '.join(COLUMNS)}")
        self._places = [header.index(name) for name in COLUMNS]

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def frames(self, seconds: float) -> list[TrackerFrame]:
        """See `Tracker`."""
        self._new_frames()
        time.sleep(seconds)
        return self._new_frames()

    def _new_frames(self) -> list[TrackerFrame]:
        *whole, self._part = (self._part + self._file.read()).split("\n")
        return [frame for frame in map(self._frame, whole) if frame is not None]

    def _frame(self, line: str) -> TrackerFrame | None:
        cells = next(csv.reader([line]), [])
        try:
            t, *position = (float(cells[place]) for place in self._places)
        except (IndexError, ValueError):
            return None
        if not all(map(math.isfinite, (t, *position))):
            return None
        self._line += 1
        return TrackerFrame(self._line, t, {self._tool: TargetPose(np.array(position) * MM, np.full((3, 3), np.nan))})
