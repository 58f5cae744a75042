"""Rows below a table of measurements that are no poses: mean, standard deviation and others of its columns.

Found by their numbers, whatever language their label has, and whether they have one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import SupportsFloat

import numpy as np

from lrm_ident.data.measurement_file.pose_quantity import POSITION
from lrm_ident.data.table_text.csv_file import CsvTable, is_number
from lrm_ident.data.wording import enumerate_words
from lrm_math.arrays import Array

STATISTICS: dict[str, Callable[[Array], SupportsFloat]] = {
    "mean": np.mean,
    "standard deviation": lambda column: np.std(column, ddof=1),
    "standard deviation (n)": np.std,
    "variance": lambda column: np.var(column, ddof=1),
    "minimum": np.min,
    "maximum": np.max,
    "median": np.median,
    "range": np.ptp,
    "sum": np.sum,
    "count": len,
    "quartile": lambda column: np.quantile(column, 0.25),
    "third quartile": lambda column: np.quantile(column, 0.75),
}  # fmt: skip
QUANTILES = frozenset({"median", "quartile", "third quartile"})
"""Of a sweep they are poses, or lie between two: they count only beside another statistic."""
LEFT_OUT = "of the rows above, left out"
MOST, LEAST_ABOVE = 10, 5
"""Rows that sum a table up, and rows that it has at least."""
ANGLES = re.compile(r"q\d+_deg")
SHARP, SHARP_COLUMNS = 0.005, 3
"""Share of a column's range by which a number tells its statistic from another number, and columns where it has to."""


def without_summary(cells: CsvTable) -> CsvTable:
    """The table without the last rows if each is one statistic of the rows above in every position and joint angle,
    and a notice of them."""
    if not {*POSITION} <= {*cells.header}:
        return cells
    angles = (name for name in cells.header if ANGLES.fullmatch(name))
    places = [cells.header.index(name) for name in (*POSITION, *angles)]
    values = np.array([[_number(row[j]) for j in places] for row in cells.rows], dtype=np.float64)
    for start in range(max(LEAST_ABOVE, len(values) - MOST), len(values)):
        columns = [column[np.isfinite(column)] for column in values[:start].T]
        with np.errstate(all="ignore"):  # whatever is absurd in a cell is said elsewhere
            named = [_statistic([row[j] for j in places], columns) for row in cells.rows[start:]]
        if all(map(len, columns)) and all(named) and _decided(named, values, start) and not _repeats(cells, start):
            lines = enumerate_words([*map(str, cells.lines[start:])], MOST)
            notice = f"line {lines}: {enumerate_words([*filter(None, named)], MOST)} {LEFT_OUT}"
            kept = replace(cells, rows=cells.rows[:start], lines=cells.lines[:start])
            return replace(kept, notices=(*cells.notices, notice))
    return cells


def summary_notices(cells: CsvTable) -> tuple[str, ...]:
    """The notices of the rows that `without_summary` left out."""
    return tuple(words for words in cells.notices if words.endswith(LEFT_OUT))


def _decided(named: Sequence[str | None], values: Array, start: int) -> bool:
    """Whether a row from `start` on is no quantile, and has not the joint angles of a row above."""
    angles = values[:, len(POSITION) :]
    return any(
        name not in QUANTILES and not (angles[:start] == row).all(axis=1).any()
        for name, row in zip(named, angles[start:], strict=True)
    )


def _repeats(cells: CsvTable, start: int) -> bool:
    """Whether a row from `start` on is a new pose that repeats one above, by `pose` and `repeat_of`."""
    if not {"pose", "repeat_of"} <= {*cells.header}:
        return False
    pose, of = (cells.header.index(name) for name in ("pose", "repeat_of"))
    above = {row[pose] for row in cells.rows[:start]}
    return any(row[pose] not in above and row[of] in above for row in cells.rows[start:])


def _statistic(row: Sequence[str], columns: Sequence[Array]) -> str | None:
    """The name of the statistic of the columns that the numbers of a row are; None if they are none."""
    there = [(cell, column) for cell, column in zip(row, columns, strict=True) if _is_finite(cell)]
    if not all(map(_is_finite, row[: len(POSITION)])):
        return None
    return next((name for name in STATISTICS if all(_matches(name, there))), None)


def _matches(name: str, there: Sequence[tuple[str, Array]]) -> Iterator[bool]:
    """Whether each number of a row is the statistic of its column, and whether enough of them are sharp."""
    sharp = 0
    for cell, column in there:
        value, close = float(STATISTICS[name](column)), 1.1 * _last_digit(cell)
        sharp += close <= SHARP * float(np.ptp(column))
        yield abs(float(cell) - value) <= close + 1e-9 * abs(value)
    yield sharp >= SHARP_COLUMNS


def _last_digit(cell: str) -> float:
    """The unit of the last digit of a number."""
    digits, _, exponent = cell.lower().partition("e")
    return float(10.0 ** (int(exponent or 0) - len(digits.partition(".")[2])))


def _is_finite(cell: str) -> bool:
    return is_number(cell) and math.isfinite(float(cell))


def _number(cell: str) -> float:
    return float(cell) if is_number(cell) else math.nan
