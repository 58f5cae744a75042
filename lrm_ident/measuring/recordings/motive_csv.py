"""CSV exports of OptiTrack's Motive, format versions 1.2x (docs.optitrack.com, "Data Export: CSV").

The first line has pairs of names and values, among them `Format Version`, `Rotation Type`, `Length Units`. After an
empty line stand rows that say of every column its `Type`, name, identifier (and its parent, in later versions), then
`Rotation` or `Position`, then `Frame, Time (Seconds), X, Y, Z, W, …`. Cells of a frame are empty where a body was not
seen. Earlier versions begin the rows of types and names with two empty cells, later ones name them in the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.conventions import LENGTH_UNITS
from lrm_ident.measuring.recordings.cells import Cells, column_numbers
from lrm_ident.measuring.recordings.take import BodyTrack, RecordedTake, matrices
from lrm_math.arrays import Array
from lrm_math.errors import FileError

UNITS = {"meters": "m", "centimeters": "cm", "millimeters": "mm"}
BODIES = ("Rigid Body", "Marker", "Bone")
"""Types of columns that have a position; a `Rigid Body Marker` repeats what its body says."""


def is_motive(cells: Cells) -> bool:
    """Whether the first line is that of such an export."""
    return bool(cells) and cells[0][0].strip() == "Format Version"


def read_motive(path: Path, cells: Cells) -> RecordedTake:
    """All bodies of an export. Raises `FileError`: not as described above, another unit, no body."""
    about = dict(zip(cells[0][0::2], cells[0][1::2], strict=False))
    scale = LENGTH_UNITS[_unit(path, about)]
    head = next((k for k, row in enumerate(cells) if row[0].strip() == "Frame"), None)
    if head is None or head < 3:
        raise FileError(path, "", "no line that begins with Frame", "should be a CSV export of Motive with its header")
    axes, kinds = cells[head], cells[head - 1]
    types = next((row for row in cells[1:head] if set(row) & set(BODIES)), None)
    if types is None:
        raise FileError(path, "header", "no rigid body and no marker", "export with Rigid Bodies switched on")
    names = cells[cells.index(types) + 1]
    rows = zip(types, names, kinds, axes, strict=False)
    place = {column[1:]: k for k, column in reversed(list(enumerate(rows))) if column[0] in BODIES}
    t, bodies = column_numbers(path, cells, head + 1, 1), {}
    for name in dict.fromkeys(n for n, kind in zip(names, types, strict=False) if kind in BODIES and n):
        places = _numbers(path, cells, head + 1, [place.get((name, "Position", axis)) for axis in "XYZ"])
        if places is None:
            continue
        numbers = _numbers(path, cells, head + 1, [place.get((name, "Rotation", axis)) for axis in "XYZW"])
        why = f"its type is {about.get('Rotation Type', 'not said')}; export with Rotation Type Quaternion"
        bodies[name] = BodyTrack(places * scale, None if numbers is None else matrices(numbers), why)
    if not bodies:
        raise FileError(path, "header", "no rigid body and no marker with a position")
    return RecordedTake(path, t, bodies)


def _numbers(path: Path, cells: Cells, first: int, columns: Sequence[int | None]) -> Array | None:
    """(N, k), columns from the row `first` on side by side; None unless all are there."""
    there = [k for k in columns if k is not None]
    if len(there) < len(columns):
        return None
    return np.stack([column_numbers(path, cells, first, k) for k in there], axis=1)


def _unit(path: Path, about: dict[str, str]) -> str:
    said = about.get("Length Units", "")
    if said.lower() not in UNITS:
        raise FileError(path, "line 1", f"Length Units is {said or 'not said'}", f"should be {', '.join(UNITS)}")
    return UNITS[said.lower()]
