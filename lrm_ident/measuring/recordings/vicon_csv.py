"""CSV exports of Vicon Tracker and Nexus.

A section has a line with its title (`Objects`, `Segments`, `Trajectories`), one with its frames per second, one with
the bodies' names above their first column, then `Frame, Sub Frame, RX, RY, RZ, TX, TY, TZ, …` (`RW` too where rotations
are quaternions; `X, Y, Z` for markers), then a line of units, then one line a frame. Sections are divided by empty
lines. The file does not say whether three numbers of a rotation are Euler angles or a helical (rotation) vector: that
is a setting of the export.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lrm_ident.data.measurement_file.conventions import LENGTH_UNITS
from lrm_ident.measuring.recordings.cells import Cells, column_numbers
from lrm_ident.measuring.recordings.take import BodyTrack, RecordedTake, matrices
from lrm_math.arrays import Array
from lrm_math.errors import FileError

TITLES = ("Objects", "Segments", "Trajectories")
PREFIX = re.compile(r"^Global (?:Angle|Translation)(?: \([^)]*\))?\s*")
"""Prefix that Tracker writes before the name of a body."""
ROTATIONS = ("helical", "euler-xyz")
AMBIGUOUS = "Euler angles and helical vectors look the same; say --rotation helical or --rotation euler-xyz"


def is_vicon(cells: Cells) -> bool:
    """Whether the first line is the title of a section."""
    return bool(cells) and cells[0][0].strip() in TITLES


def read_vicon(path: Path, cells: Cells, rotation: str | None) -> RecordedTake:
    """All bodies of all sections.

    Args:
        rotation: what three numbers of a rotation are, one of `ROTATIONS`; None: not known.

    Raises `FileError`: not as described above, other units, sections of different lengths.
    """
    begins = [k for k, row in enumerate(cells) if row[0].strip() in TITLES]
    t, bodies = None, dict[str, BodyTrack]()
    for begin, end in zip(begins, [*begins[1:], len(cells)], strict=True):
        section = [row for row in cells[begin:end] if any(cell.strip() for cell in row)]
        times, found = _section(path, section, rotation)
        if t is not None and len(times) != len(t):
            raise FileError(path, cells[begin][0], f"{len(times)} frames, the section before has {len(t)}")
        t, bodies = times, {**found, **bodies}
    assert t is not None
    if not bodies:
        raise FileError(path, "header", "no body with a position")
    return RecordedTake(path, t, bodies)


def _section(path: Path, rows: Cells, rotation: str | None) -> tuple[Array, Mapping[str, BodyTrack]]:
    title = rows[0][0].strip()
    if len(rows) < 6 or rows[3][0].strip() != "Frame":
        raise FileError(path, title, "no line that begins with Frame, or no frames below it")
    try:
        rate = float(rows[1][0])
    except ValueError:
        rate = 0.0
    if not rate > 0.0:
        raise FileError(path, f"{title}, second line", f"'{rows[1][0]}' is no number of frames per second")
    table = rows[:5] + [row for row in rows[5:] if row[0].strip()]
    frame = column_numbers(path, table, 5, 0)
    places: dict[str, dict[str, int]] = {}
    name = ""
    for k in range(2, len(rows[3])):
        name = PREFIX.sub("", rows[2][k].strip()) if k < len(rows[2]) and rows[2][k].strip() else name
        places.setdefault(name, {})[rows[3][k].strip()] = k
    bodies = {}
    for name, axes in places.items():
        wanted = next((kind for kind in (("TX", "TY", "TZ"), ("X", "Y", "Z")) if set(kind) <= set(axes)), None)
        if not name or wanted is None:
            continue
        scale = _scale(path, rows[4], [axes[axis] for axis in wanted])
        position = np.stack([column_numbers(path, table, 5, axes[axis]) for axis in wanted], axis=1) * scale
        bodies[name] = _body(path, table, axes, position, rotation)
    return (frame - frame[0]) / rate, bodies


def _body(path: Path, rows: Cells, axes: Mapping[str, int], position: Array, rotation: str | None) -> BodyTrack:
    names = [axis for axis in ("RX", "RY", "RZ", "RW") if axis in axes]
    lost = ~np.abs(position).any(axis=1)  # Tracker writes zeros for an object that it has lost
    position[lost] = np.nan
    if len(names) < 3:
        return BodyTrack(position)
    turn = np.stack([column_numbers(path, rows, 5, axes[name]) for name in names], axis=1)
    turn[lost] = np.nan
    if len(names) == 4:
        return BodyTrack(position, matrices(turn))
    if rotation is None:
        return BodyTrack(position, None, AMBIGUOUS)
    unit = rows[4][axes["RX"]].strip()
    if unit not in ("deg", "rad"):
        raise FileError(path, "units of the rotations", f"'{unit}'", "should be deg or rad")
    known = np.isfinite(turn).all(axis=1)
    out = np.full((len(turn), 3, 3), np.nan)
    angles = turn[known] * (np.pi / 180.0 if unit == "deg" else 1.0)
    if known.any():
        turned = Rotation.from_rotvec(angles) if rotation == "helical" else Rotation.from_euler("XYZ", angles)
        out[known] = turned.as_matrix()
    return BodyTrack(position, out)


def _scale(path: Path, units: Sequence[str], places: Sequence[int]) -> float:
    said = {units[k].strip() if k < len(units) else "" for k in places}
    if len(said) != 1 or not said <= {"mm", "cm", "m"}:
        raise FileError(path, "units of the positions", f"'{', '.join(sorted(said))}'", "should be mm, cm or m")
    return LENGTH_UNITS[said.pop()]
