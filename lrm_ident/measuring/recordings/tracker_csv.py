"""Exports of trackers: CSV of OptiTrack's Motive, of Vicon's Tracker and Nexus, and the plain `t_s, x_mm, y_mm, z_mm`.

Motive, format versions 1.2x (docs.optitrack.com, "Data Export: CSV"): the first line has pairs of names and values,
among them `Format Version`, `Rotation Type`, `Length Units`. After an empty line stand rows that say of every column
its `Type`, name, identifier (and its parent, in later versions), then `Rotation` or `Position`, then `Frame, Time
(Seconds), X, Y, Z, W, …`. Cells of a frame are empty where a body was not seen. Earlier versions begin the rows of
types and names with two empty cells, later ones name them in the second.

Vicon: a section has a line with its title (`Objects`, `Segments`, `Trajectories`), one with its frames per second, one
with the bodies' names above their first column, then `Frame, Sub Frame, RX, RY, RZ, TX, TY, TZ, …` (`RW` too where
rotations are quaternions; `X, Y, Z` for markers), then a line of units, then one line a frame. Sections are divided by
empty lines. The file does not say whether three numbers of a rotation are Euler angles or a helical (rotation) vector:
that is a setting of the export.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lrm_ident.data.measurement_file.conventions import LENGTH_UNITS
from lrm_ident.data.table_text.csv_file import DECIMAL_COMMA
from lrm_ident.measuring.recordings.take import BodyTrack, RecordedTake, matrices
from lrm_ident.measuring.tracker.growing_csv import COLUMNS as PLAIN
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError

UNITS = {"meters": "m", "centimeters": "cm", "millimeters": "mm"}
BODIES = ("Rigid Body", "Marker", "Bone")
"""Types of columns that have a position; a `Rigid Body Marker` repeats what its body says."""
MOTIVE = "Format Version"
"""First cell of an export of Motive."""
TITLES = ("Objects", "Segments", "Trajectories")
PREFIX = re.compile(r"^Global (?:Angle|Translation)(?: \([^)]*\))?\s*")
"""Prefix that Tracker writes before the name of a body."""
ROTATIONS = ("helical", "euler-xyz")
AMBIGUOUS = "Euler angles and helical vectors look the same; say --rotation helical or --rotation euler-xyz"
Cells = list[list[str]]


def table_cells(path: Path, text: str) -> Cells:
    """All lines, empty ones as one empty cell, without spaces around; semicolons, tabs or commas.

    As Excel saves an export: with a line `sep=;`, and decimal commas where commas do not divide cells.
    Raises `FileError`.
    """
    text = re.sub(r'\A"?sep=."?\s*\n', "", text, flags=re.IGNORECASE)
    delimiter = max(";\t,", key=text.count)
    try:
        rows = list(csv.reader(text.splitlines(), delimiter=delimiter))
    except csv.Error as error:
        raise FileError(path, "", f"is no table ({error})") from None
    cells = [[cell.strip() for cell in row] or [""] for row in rows]
    if delimiter == ",":
        return cells
    return [[cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell) else cell for cell in row] for row in cells]


def _numbers(path: Path, rows: Cells, first: int, columns: Sequence[int]) -> Array:
    """(N, k), columns side by side from the row `first` on, NaN for an empty or a missing cell. Raises `FileError`."""
    out = np.full((len(rows) - first, len(columns)), np.nan)
    for j, column in enumerate(columns):
        for k, row in enumerate(rows[first:]):
            if cell := row[column] if column < len(row) else "":
                try:
                    out[k, j] = float(cell)
                except ValueError:
                    raise FileError(path, f"line {first + k + 1} of the table", f"'{cell}' is not a number") from None
    return out


def plain_take(path: Path, cells: Cells) -> RecordedTake:
    """The tip of a plain table."""
    numbers = _numbers(path, cells, 1, [cells[0].index(name) for name in PLAIN])
    return RecordedTake(path, numbers[:, 0], {"tip": BodyTrack(numbers[:, 1:] * MM)})


def motive_take(path: Path, cells: Cells) -> RecordedTake:
    """All bodies of an export of Motive. Raises `FileError`."""
    about = dict(zip(cells[0][0::2], cells[0][1::2], strict=False))
    unit = about.get("Length Units", "")
    if unit.lower() not in UNITS:
        raise FileError(path, "line 1", f"Length Units is {unit or 'not said'}", f"should be {', '.join(UNITS)}")
    head = next((k for k, row in enumerate(cells) if row[0] == "Frame"), None)
    if head is None or head < 3:
        raise FileError(path, "", "no line that begins with Frame", "should be a CSV export of Motive with its header")
    cells = cells[: head + 1] + [row for row in cells[head + 1 :] if any(row)]
    if len(cells) == head + 1:
        raise FileError(path, "", "no frames below the line that begins with Frame")
    axes, kinds = cells[head], cells[head - 1]
    types = next((row for row in cells[1:head] if set(row) & set(BODIES)), None)
    if types is None:
        raise FileError(path, "header", "no rigid body and no marker", "export with Rigid Bodies switched on")
    names = cells[cells.index(types) + 1]
    rows = zip(types, names, kinds, axes, strict=False)
    place = {column[1:]: k for k, column in reversed(list(enumerate(rows))) if column[0] in BODIES}
    t, bodies = _numbers(path, cells, head + 1, [1])[:, 0], {}
    for name in dict.fromkeys(n for n, kind in zip(names, types, strict=False) if kind in BODIES and n):
        position, rotation = (
            [place[name, kind, axis] for axis in wanted if (name, kind, axis) in place]
            for kind, wanted in (("Position", "XYZ"), ("Rotation", "XYZW"))
        )
        if len(position) == 3:
            why = f"its type is {about.get('Rotation Type', 'not said')}; export with Rotation Type Quaternion"
            turn = matrices(_numbers(path, cells, head + 1, rotation)) if len(rotation) == 4 else None
            tip = _numbers(path, cells, head + 1, position) * LENGTH_UNITS[UNITS[unit.lower()]]
            bodies[name] = BodyTrack(tip, turn, why)
    if not bodies:
        raise FileError(path, "header", "no rigid body and no marker with a position")
    return RecordedTake(path, t, bodies)


def vicon_take(path: Path, cells: Cells, rotation: str | None) -> RecordedTake:
    """All bodies of an export of Vicon; `rotation`: one of `ROTATIONS`. Raises `FileError`."""
    begins = [k for k, row in enumerate(cells) if row[0] in TITLES]
    t, bodies = None, dict[str, BodyTrack]()
    for begin, end in zip(begins, [*begins[1:], len(cells)], strict=True):
        times, sections = _section(path, [row for row in cells[begin:end] if any(row)], rotation)
        if t is not None and len(times) != len(t):
            raise FileError(path, cells[begin][0], f"{len(times)} frames, the section before has {len(t)}")
        t, bodies = times, {**sections, **bodies}
    assert t is not None
    if not bodies:
        raise FileError(path, "header", "no body with a position")
    return RecordedTake(path, t, bodies)


def _section(path: Path, rows: Cells, rotation: str | None) -> tuple[Array, Mapping[str, BodyTrack]]:
    title, rows = rows[0][0], rows[:5] + [row for row in rows[5:] if row[0]]
    if len(rows) < 6 or rows[3][0] != "Frame":
        raise FileError(path, title, "no line that begins with Frame, or no frames below it")
    try:
        rate = float(rows[1][0])
    except ValueError:
        rate = 0.0
    if not rate > 0.0:
        raise FileError(path, f"{title}, second line", f"'{rows[1][0]}' is no number of frames per second")
    frame = _numbers(path, rows, 5, [0])[:, 0]
    places: dict[str, dict[str, int]] = {}
    name = ""
    for k in range(2, len(rows[3])):
        name = PREFIX.sub("", rows[2][k]) if k < len(rows[2]) and rows[2][k] else name
        places.setdefault(name, {})[rows[3][k]] = k
    bodies = {}
    for name, axes in places.items():
        wanted = next((kind for kind in (("TX", "TY", "TZ"), ("X", "Y", "Z")) if set(kind) <= set(axes)), None)
        if name and wanted is not None:
            columns = [axes[axis] for axis in wanted]
            position = _numbers(path, rows, 5, columns) * _scale(path, rows[4], columns)
            bodies[name] = _body(path, rows, axes, position, rotation)
    return (frame - frame[0]) / rate, bodies


def _body(path: Path, rows: Cells, axes: Mapping[str, int], position: Array, rotation: str | None) -> BodyTrack:
    columns = [axes[axis] for axis in ("RX", "RY", "RZ", "RW") if axis in axes]
    lost = ~np.abs(position).any(axis=1)  # Tracker writes zeros for an object that it has lost
    position[lost] = np.nan
    if len(columns) < 3:
        return BodyTrack(position)
    turn = _numbers(path, rows, 5, columns)
    turn[lost] = np.nan
    if len(columns) == 4:
        return BodyTrack(position, matrices(turn))
    if rotation is None:
        return BodyTrack(position, None, AMBIGUOUS)
    unit = rows[4][axes["RX"]]
    if unit not in ("deg", "rad"):
        raise FileError(path, "units of the rotations", f"'{unit}'", "should be deg or rad")
    measured = np.isfinite(turn).all(axis=1)
    out = np.full((len(turn), 3, 3), np.nan)
    angles = turn[measured] * (np.pi / 180.0 if unit == "deg" else 1.0)
    if measured.any():
        turned = Rotation.from_rotvec(angles) if rotation == "helical" else Rotation.from_euler("XYZ", angles)
        out[measured] = turned.as_matrix()
    return BodyTrack(position, out)


def _scale(path: Path, units: Sequence[str], places: Sequence[int]) -> float:
    said = {units[k] if k < len(units) else "" for k in places}
    if len(said) != 1 or not said <= {"mm", "cm", "m"}:
        raise FileError(path, "units of the positions", f"'{', '.join(sorted(said))}'", "should be mm, cm or m")
    return LENGTH_UNITS[said.pop()]
