"""Touched points: which point the tip was held in (`point`), and where what carries it stood (`placement`).

Where the points' places on one board are known, by coordinates or by the distances between all of them, they move
together with that board; else every point of every placement stands by itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.number_table import NumberTable, cell_error
from lrm_ident.data.measurement_file.pose_quantity import PLACEMENT, POINT, POSITION
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.touched_points import TouchedFrame, TouchedPoints
from lrm_ident.data.table_text.csv_file import CsvTable
from lrm_ident.data.wording import enumerate_words
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.effects.tracker_errors import MOST_PLACEMENTS
from lrm_math.errors import FileError

ONE_PLACEMENT = "1"
BETWEEN = "-"
"""Between the names of two points of one distance."""
LARGEST_STRAIN = 0.02
"""Share of the longest distance that distances may contradict each other by: more is a typing error."""
LEAST_TOUCHES = 2
NOMINAL = 0.03
"""Weight of a nominal coordinate over that of a measured distance: what a printer does against a caliper."""
ADJUSTMENTS = 5


def with_touches(data: Measurements, table: NumberTable, metadata: Metadata) -> Measurements:
    """The measurements with the touched points as positions, each in the frame of what carries it.

    Raises `FileError`: positions beside them, an empty cell, distances that do not determine where the points are, or
    an unknown name.
    """
    names = table.words(POINT)
    path = table.cells.path
    if names is None:
        return data
    if "position" in table or "distance" in table:
        columns = POSITION if "position" in table else ("distance_mm",)
        right = f"a file of touches has {POINT} and {PLACEMENT}; leave out {', '.join(columns)}"
        raise FileError(path, "header", "positions or distances beside touched points", right)
    for row, name in enumerate(names):
        if not name:
            raise cell_error(table.cells, row, POINT, "the cell is empty", "the name of the point that was touched")
    placements = table.words(PLACEMENT) or [""] * len(names)
    placements = [name or ONE_PLACEMENT for name in placements]
    points_known = known_points(path.with_suffix(".toml"), metadata, dict.fromkeys(names))
    if points_known and (strange := [row for row, name in enumerate(names) if name not in points_known]):
        table_name, row = "points" if metadata.points else "distances", strange[0]
        right = f"known are: {enumerate_words([*points_known], 12)}"
        raise cell_error(table.cells, row, POINT, f"'{names[row]}' is not in [{table_name}]", right)
    frames, number = _frames(names, placements, points_known)
    if len(frames) > MOST_PLACEMENTS:
        what = f"{len(frames)} places to identify, of boards and of points without known distances"
        raise FileError(path, "", what, f"at most {MOST_PLACEMENTS}; state the points' places in [points]")
    tcp = np.array([points_known.get(name, np.zeros(3)) for name in names])
    seen, placed = data.positions, replace(data, poses=replace(data.poses, placement=number))
    touched = placed.with_positions(TouchedPoints(tcp, seen.sd, seen.blocks, noise_sd=seen.noise_sd, frames=frames))
    return touched.noting(*_notices(touched))


def require_points(cells: CsvTable, metadata: Metadata) -> None:
    """Raises `FileError`: the file beside the data states touched points, and the data name none."""
    if (metadata.points or metadata.distances) and POINT not in cells.header:
        there = "points" if metadata.points else "distances"
        raise FileError(cells.path, "header", f"no column {POINT}, though [{there}] beside it are of touched points")


def _frames(
    names: list[str], placements: list[str], points_known: Mapping[str, Array]
) -> tuple[tuple[TouchedFrame, ...], np.ndarray[tuple[int, ...], np.dtype[np.int64]]]:
    """Boards and lone points in the order of the rows, those touched once last; their number from 1 at each row."""
    owner = [(place, "" if name in points_known else name) for name, place in zip(names, placements, strict=True)]
    order = sorted(dict.fromkeys(owner), key=lambda owner_of: owner.count(owner_of) < LEAST_TOUCHES)
    frames = []
    for place, name in order:
        here = [n for n, owner_of in zip(names, owner, strict=True) if owner_of == (place, name)]
        points = tuple(dict.fromkeys(here))
        spread = np.array([points_known.get(point, np.zeros(3)) for point in points])
        frames.append(TouchedFrame(place, points, bool(np.ptp(spread, axis=0).max() > 0.0)))
    return tuple(frames), np.array([order.index(owner_of) + 1 for owner_of in owner], dtype=np.int64)


def _notices(data: Measurements) -> Iterator[str]:
    """Notices of what these touches can tell, and what not."""
    boards = [frame for frame in data.touched if frame.turns]
    counts = [] if data.poses.placement is None else np.bincount(data.poses.placement)[1:].tolist()
    named = enumerate(zip(data.touched, counts, strict=True), start=1)
    which = [f"placement{number} = {frame.words} ({count})" for number, (frame, count) in named]
    yield f"touches at each place, which is identified together with the arm: {enumerate_words(which, 12)}"
    yield "touches show neither where the base stands nor where the zero of joint 1 is"
    if not boards:
        yield (
            "no distance between touched points is known, so the scale of the arm is not measured: its longest length "
            "is held as drawn; state [points] or [distances] in the file beside the data"
        )


def without_lone(data: Measurements) -> Measurements:
    """The measurements without what was touched once only, which says nothing: it could stand anywhere.

    Raises `FileError` if that is all.
    """
    placement = data.poses.placement
    if placement is None:
        return data
    lone = np.bincount(placement)[placement] < LEAST_TOUCHES
    if lone.all():
        right = "touch each point again from other sides, or state the points' places in [points]"
        raise data.source.fault("every point was touched once only, which says nothing", right)
    if not lone.any():
        return data
    gone = data.pose[lone].tolist()
    notice = f"touched once, which says nothing; left out: pose {enumerate_words([str(n) for n in gone], 8)}"
    remaining = data.without(gone)
    kept = [
        replace(observation, frames=observation.frames[: int(placement[~lone].max())])
        for observation in remaining.of(TouchedPoints)
    ]
    return replace(remaining, observations=(*kept, *remaining.observations[1:])).noting(notice)


def known_points(path: object, metadata: Metadata, touched: Mapping[str, object]) -> dict[str, Array]:
    """Places of points in the frame of their board (m), by name; empty if they are not known.

    Raises `FileError`: too few distances, or some that contradict each other or the points.
    """
    if metadata.points is not None:
        nominal = {name: np.array(place) * MM for name, place in metadata.points.items()}
        return _adjusted(path, nominal, metadata.distances or {})
    if metadata.distances is None:
        return {}
    return _from_distances(path, metadata.distances, touched)


def _adjusted(path: object, nominal: Mapping[str, Array], distances: Mapping[str, float]) -> dict[str, Array]:
    """Nominal places (m) adjusted to what distances (mm) were measured between some of them, by least squares.

    Raises `FileError`: of no two of the points, or a distance far from the nominal one.
    """
    if not distances:
        return dict(nominal)
    names = [*nominal]
    places = np.array([nominal[name] for name in names])
    rows = []
    for key, value in distances.items():
        pair = _pair(path, key, nominal)
        a, b = names.index(pair.first), names.index(pair.second)
        drawn = float(np.linalg.norm(places[a] - places[b]))
        if abs(value * MM - drawn) > LARGEST_STRAIN * drawn + MM:
            what = f"{value:g} mm, {drawn / MM:.1f} mm by [points]"
            raise FileError(path, f"distances.{key}", what, "measure it again, or correct [points]")
        rows.append((a, b, value * MM))
    adjusted = places.copy()
    for _ in range(ADJUSTMENTS):
        J, residual = np.zeros((len(rows) + places.size, places.size)), np.empty(len(rows) + places.size)
        for row, (a, b, length) in enumerate(rows):
            line = adjusted[a] - adjusted[b]
            line_length = float(np.linalg.norm(line))
            J[row, 3 * a : 3 * a + 3], J[row, 3 * b : 3 * b + 3] = line / line_length, -line / line_length
            residual[row] = length - line_length
        J[len(rows) :], residual[len(rows) :] = NOMINAL * np.eye(places.size), NOMINAL * (places - adjusted).ravel()
        adjusted = adjusted + np.linalg.lstsq(J, residual, rcond=None)[0].reshape(-1, 3)
    return dict(zip(names, adjusted, strict=True))


@dataclass(frozen=True)
class _Pair:
    first: str
    second: str


def _from_distances(path: object, distances: Mapping[str, float], touched: Mapping[str, object]) -> dict[str, Array]:
    """Places (m) by classical scaling (Torgerson 1952) of the distances between all of some points."""
    length: dict[frozenset[str], float] = {}
    names: dict[str, None] = {}
    for key, value in distances.items():
        pair = _pair(path, key, touched)
        length[frozenset((pair.first, pair.second))] = value * MM
        names |= dict.fromkeys((pair.first, pair.second))
    points = list(names)
    missing = [f"{a}{BETWEEN}{b}" for a, b in combinations(points, 2) if frozenset((a, b)) not in length]
    if missing:
        what = f"the distance {missing[0]} is missing"
        raise FileError(path, "distances", what, f"state all {len(points) * (len(points) - 1) // 2}, or [points]")
    D = np.array([[0.0 if a == b else length[frozenset((a, b))] for b in points] for a in points])
    centring = np.eye(len(points)) - 1.0 / len(points)
    values, vectors = np.linalg.eigh(-0.5 * centring @ D**2 @ centring)
    most = np.argsort(values)[::-1][:3]
    places = vectors[:, most] * np.sqrt(np.maximum(values[most], 0.0))
    places = np.pad(places, ((0, 0), (0, 3 - places.shape[1])))
    between = np.linalg.norm(places[:, None] - places[None], axis=2)
    wrong = np.abs(between - D)
    a, b = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
    if wrong[a, b] > LARGEST_STRAIN * D.max():
        what = f"{points[a]}{BETWEEN}{points[b]} = {D[a, b] / MM:g} mm contradicts the other distances, which make it "
        raise FileError(path, "distances", f"{what}{between[a, b] / MM:.1f} mm", "measure it again")
    if np.sqrt(max(values[most[-1]], 0.0)) > LARGEST_STRAIN * D.max() and len(points) > 3:
        what = "the points do not lie in a plane, and distances do not tell them from their mirror image"
        raise FileError(path, "distances", what, "state [points], too")
    return dict(zip(points, places, strict=True))


def _pair(path: object, key: str, touched: Mapping[str, object]) -> _Pair:
    """The two points of a distance. Raises `FileError`: no such points."""
    for at in (k for k, letter in enumerate(key) if letter == BETWEEN):
        first, second = key[:at].strip(), key[at + 1 :].strip()
        if first in touched and second in touched and first != second:
            return _Pair(first, second)
    right = f"two touched points as A{BETWEEN}B; touched are: {enumerate_words([*touched], 12)}"
    raise FileError(path, f"distances.{key}", "is of no two touched points", right)
