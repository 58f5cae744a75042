"""Readers of recordings, of whatever program: a further format is a further line of `READERS`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from lrm_ident.data.table_text.csv_file import read_text
from lrm_ident.measuring.recordings.dtrack_file import dtrack_take, is_dtrack
from lrm_ident.measuring.recordings.mcap_file import SUFFIX as MCAP
from lrm_ident.measuring.recordings.mcap_file import read_mcap
from lrm_ident.measuring.recordings.take import RecordedTake
from lrm_ident.measuring.recordings.tracker_csv import (
    MOTIVE,
    TITLES,
    Cells,
    motive_take,
    plain_take,
    table_cells,
    vicon_take,
)
from lrm_ident.measuring.tracker.growing_csv import COLUMNS as PLAIN
from lrm_math.errors import FileError


@dataclass(frozen=True)
class RecordingFile:
    """A file that may be a recording.

    Attributes:
        rotation: what three numbers of a rotation are that Vicon has written, one of `ROTATIONS`; None: not known.
    """

    path: Path
    rotation: str | None = None

    @cached_property
    def text(self) -> str:
        """Its text. Raises `FileError`: it has none."""
        return read_text(self.path).text

    @cached_property
    def cells(self) -> Cells:
        """Cells of its lines. Raises `FileError`."""
        return table_cells(self.path, self.text)

    @property
    def begin(self) -> str:
        """Its first cell."""
        return self.cells[0][0] if self.cells else ""


@dataclass(frozen=True)
class RecordingReader:
    """Reader of one format.

    Attributes:
        name: of the format, as helps and errors state it.
        recognises: whether a file is of it; asked in the order of `READERS`.
        read: all bodies of the file. Raises `FileError`.
    """

    name: str
    recognises: Callable[[RecordingFile], bool]
    read: Callable[[RecordingFile], RecordedTake]


READERS = (
    RecordingReader("an MCAP file", lambda file: file.path.suffix == MCAP, lambda file: read_mcap(file.path)),
    RecordingReader(
        "DTrack's ASCII output", lambda file: is_dtrack(file.text), lambda file: dtrack_take(file.path, file.text)
    ),
    RecordingReader(
        "a CSV of OptiTrack Motive", lambda file: file.begin == MOTIVE, lambda file: motive_take(file.path, file.cells)
    ),
    RecordingReader(
        "a CSV of Vicon Tracker or Nexus",
        lambda file: file.begin in TITLES,
        lambda file: vicon_take(file.path, file.cells, file.rotation),
    ),
    RecordingReader(
        f"a CSV with {', '.join(PLAIN)}",
        lambda file: bool(file.cells) and {*PLAIN} <= {*file.cells[0]},
        lambda file: plain_take(file.path, file.cells),
    ),
)
FORMATS = f"{', '.join(reader.name for reader in READERS[:-1])}, or {READERS[-1].name}"
"""The formats in words."""


def read_take(path: Path, rotation: str | None = None) -> RecordedTake:
    """All bodies of a recording.

    Args:
        rotation: see `RecordingFile`.

    Raises `FileError`: none of `FORMATS`; other units, no body, sections of different lengths.
    """
    file = RecordingFile(path, rotation)
    reader = next((entry for entry in READERS if entry.recognises(file)), None)
    if reader is None:
        right = f"should be a .mat file of positions, {FORMATS}"
        raise FileError(path, "line 1", f"begins with '{file.begin[:30]}'", right)
    return reader.read(file)
