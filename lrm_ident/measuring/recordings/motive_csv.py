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

from lrm_ident.data.apply_reading import LENGTH_UNITS
from lrm_ident.measuring.recordings.cells import Cells, column_numbers
from lrm_ident.measuring.recordings.take import BodyTrack, RecordedTake, matrices
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
    t, columns = column_numbers(path, cells, head + 1, 1), _Columns(axes, kinds, types, names)
    bodies = {}
    for name in dict.fromkeys(n for n, kind in zip(names, types, strict=False) if kind in BODIES and n):
        position = columns.of(name, "Position", "XYZ")
        if position is None:
            continue
        places = np.stack([column_numbers(path, cells, head + 1, k) for k in position], axis=1)
        turn = columns.of(name, "Rotation", "XYZW")
        numbers = None if turn is None else np.stack([column_numbers(path, cells, head + 1, k) for k in turn], axis=1)
        why = f"its type is {about.get('Rotation Type', 'not said')}; export with Rotation Type Quaternion"
        bodies[name] = BodyTrack(places * scale, None if numbers is None else matrices(numbers), why)
    if not bodies:
        raise FileError(path, "header", "no rigid body and no marker with a position")
    return RecordedTake(path, t, bodies)


class _Columns:
    """Finds columns of an export by type, name, kind and axis."""

    def __init__(self, axes: Sequence[str], kinds: Sequence[str], types: Sequence[str], names: Sequence[str]) -> None:
        rows = zip(types, names, kinds, axes, strict=False)
        self._place = {
            (name, kind, axis): k for k, (of, name, kind, axis) in reversed(list(enumerate(rows))) if of in BODIES
        }

    def of(self, name: str, kind: str, axes: str) -> list[int] | None:
        """Places of the columns of some axes; None unless all are there."""
        found = [self._place.get((name, kind, axis)) for axis in axes]
        return None if None in found else [place for place in found if place is not None]


def _unit(path: Path, about: dict[str, str]) -> str:
    said = about.get("Length Units", "")
    if said.lower() not in UNITS:
        raise FileError(path, "line 1", f"Length Units is {said or 'not said'}", f"should be {', '.join(UNITS)}")
    return UNITS[said.lower()]
