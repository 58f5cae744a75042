"""CSV tables with a header: cells as text, and known columns of them as numbers; errors name line and column.

Cells of measurements that are no numbers are all named at once, or their rows are left out where that is asked for.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.wording import enumerate_words
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.plausibility import PlausibleSize, implausible_value, times

LISTED = 8
ABOVE_ZERO = ("sd_mm", "sx_mm", "sy_mm", "sz_mm", "srot_deg", "distance_mm", "distance_sd_mm")
WHOLE = ("pose", "repeat_of")
ANGLE, FEEDBACK, SIDE = "q{}_deg", "q{}_meas_deg", "approach{}"
"""Columns of each joint, by its number from 1."""
SIDES = (-1.0, 0.0, 1.0)
DATES = "seconds since the start, or dates as 2024-07-15T10:15:00"
TIME = PlausibleSize("time since the start", "s", 0.0, 1e10, times(milliseconds=1e-3), DATES)
SD = PlausibleSize("standard deviation of a position", "mm", 0.0, 100.0, times(micrometres=1e-3))
TURN_SD = PlausibleSize("standard deviation of an angle", "deg", 0.0, 45.0)
PLAUSIBLE = {
    "t_s": TIME,
    "temp_c": PlausibleSize("temperature", "degC", 0.0, 150.0, {"kelvin": (1.0, -273.15)}),
    "supply_v": PlausibleSize("supply voltage", "V", 0.5, 500.0, times(millivolts=1e-3)),
    **dict.fromkeys(("sd_mm", "sx_mm", "sy_mm", "sz_mm", "noise_sd_mm", "distance_sd_mm"), SD),
    **dict.fromkeys(("srot_deg", "feedback_sd_deg"), TURN_SD),
}
"""Sizes that columns and keys of metadata can have, whatever the arm."""


def columns_of_joints(form: str, dof: int) -> tuple[str, ...]:
    """The columns of one form, as `ANGLE`, of so many joints."""
    return tuple(form.format(number) for number in range(1, dof + 1))


@dataclass(frozen=True)
class Column:
    """A column: its `name`, the file's own name `stated`, and the `factor` by which its numbers are multiplied."""

    name: str
    stated: str
    factor: float = 1.0


@dataclass(frozen=True)
class CsvTable:
    """Cells of a CSV file as text.

    Attributes:
        lines: line number in the file of each row; `header_line`: of the header.
        sha256: of the file. notices: what a person should know of its text.
    """

    path: Path
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    header_line: int = 1
    sha256: str = ""
    notices: tuple[str, ...] = ()

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)

    def numbers(self, name: str, may_be_empty: bool = False) -> Array:
        """(N,), one column as finite numbers in our unit, NaN in empty cells if there may be some.

        Raises `FileError`.
        """
        for row, what in self.faults(name, may_be_empty):
            raise FileError(self.path, self.at(row, name), what)
        j = self.header.index(name)
        values = [float(row[j]) if row[j].strip() else math.nan for row in self.rows]
        return np.array(values, dtype=np.float64) * self.columns[j].factor

    def at(self, row: int, name: str) -> str:
        """Location of a cell for error messages."""
        stated = next((column.stated for column in self.columns if column.name == name), name)
        return f"line {self.lines[row]}, column {stated}"

    def reject(self, bad: NDArray[np.bool_], name: str, what: str, right: str = "") -> None:
        """Raises `FileError` at the first row where `bad` (N,) holds."""
        if bad.any():
            raise FileError(self.path, self.at(int(np.argmax(bad)), name), what, right)

    def faults(self, name: str, may_be_empty: bool = False) -> Iterator[tuple[int, str]]:
        """Rows whose cell is no finite number, and why; an empty one counts unless it may be empty."""
        j = self.header.index(name)
        for i, row in enumerate(self.rows):
            if what := _fault(row[j], may_be_empty):
                yield i, what


def _fault(cell: str, may_be_empty: bool) -> str:
    """Why a cell is no finite number; empty if it is one."""
    if not cell.strip():
        return "" if may_be_empty else "the cell is empty"
    try:
        return "" if math.isfinite(float(cell)) else f"'{cell}' is not a finite number"
    except ValueError:
        return f"'{cell}' is not a number"


def require(table: CsvTable, required: Sequence[str]) -> CsvTable:
    """The table, its required columns named as requested. Raises `FileError`: a missing or doubled column, no rows."""
    ours = {name.lower(): name for name in required}
    columns = tuple(replace(column, name=ours.get(column.name.lower(), column.name)) for column in table.columns)
    times_there = Counter(column.name for column in columns)
    missing = [name for name in required if name not in times_there]
    if missing:
        raise FileError(table.path, "header", f"missing column {missing[0]}", f"required: {', '.join(required)}")
    twice = [name for name, count in times_there.items() if count > 1 and name]
    if twice:
        raise FileError(table.path, "header", f"column {twice[0]} stands twice")
    if not table.rows:
        raise FileError(table.path, "", "no rows below the header")
    return replace(table, columns=columns)


@dataclass(frozen=True)
class KnownColumns:
    """Columns that a file may have.

    Attributes:
        names: all of them. may_be_empty: those of which a cell may be empty.
        together: columns that are stated all or none, and what they are if a row states all of them or none, else "".
        plausible: sizes of their numbers beside those of `PLAUSIBLE`.
    """

    names: Collection[str]
    may_be_empty: Collection[str] = ()
    together: Mapping[tuple[str, ...], str] = field(default_factory=dict)
    plausible: Mapping[str, PlausibleSize] = field(default_factory=dict)


def column_notices(table: CsvTable, known: KnownColumns) -> list[str]:
    """Columns that are not used, and those that are read under another name or in another unit."""
    unknown = [name for name in table.header if name and name not in known.names]
    notices = [f"columns not used: {', '.join(unknown)}"] if unknown else []
    taken = [
        f"{own.name} = '{own.stated}'" + ("" if own.factor == 1.0 else f" times {own.factor:.6g}")
        for own in table.columns
        if own.name in known.names
        and own.name != own.stated
        and (own.factor != 1.0 or not own.stated.lower().startswith(own.name))
    ]
    return [*notices, f"read as: {', '.join(taken)}"] if taken else notices


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Columns (N,) by name, and (N, k) of those that go together by their names; NaN where a cell is empty.

    `cells`: where they come from.
    """

    cells: CsvTable
    columns: Mapping[str, Array]
    together: Mapping[tuple[str, ...], Array]

    def __len__(self) -> int:
        return len(self.cells.rows)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def integers(self, name: str) -> NDArray[np.int64]:
        """(N,), a column of whole numbers."""
        return self.columns[name].astype(np.int64)


def read_numbers(cells: CsvTable, known: KnownColumns) -> NumberTable:
    """The known columns, as far as they are there. Raises `FileError`: what is no number, or cannot be one."""
    columns = {
        name: _seconds(cells) if name == "t_s" else cells.numbers(name, name in known.may_be_empty)
        for name in cells.header
        if name in known.names
    }
    sizes = {**PLAUSIBLE, **known.plausible}
    for name, values in columns.items():
        if name in ABOVE_ZERO:
            cells.reject(values <= 0, name, "not above zero")
        elif name in WHOLE:
            cells.reject(np.nan_to_num(values) % 1.0 != 0.0, name, "not a whole number")
        elif name == "payload_g":
            cells.reject(values < 0, name, "a negative load")
        elif name.startswith("approach"):
            cells.reject(~np.isin(values, SIDES), name, "not a side", "1, -1, or 0 if unknown")
        if name in sizes and (found := implausible_value(sizes[name], values)):
            raise FileError(cells.path, cells.at(found.row, name), found.what, found.right)
    return NumberTable(cells, columns, dict(_together(cells, columns, known.together)))


def _together(
    cells: CsvTable, columns: Mapping[str, Array], groups: Mapping[tuple[str, ...], str]
) -> Iterator[tuple[tuple[str, ...], Array]]:
    """(N, k) of each group of columns that is there. Raises `FileError` for a part of one."""
    for names, whole in groups.items():
        missing = [name for name in names if name not in columns]
        if len(missing) == len(names):
            continue
        if missing:
            right = f"{', '.join(names)} go together"
            raise FileError(cells.path, "header", f"no column {missing[0]}", right)
        values = np.stack([columns[name] for name in names], axis=1)
        gone = np.isnan(values)
        for empty, name in zip(gone.T, names, strict=True):
            cells.reject(empty & ~gone.all(axis=1) & bool(whole), name, f"empty, the rest of the {whole} is not")
        yield names, values


def _seconds(cells: CsvTable) -> Array:
    """(N,), times as numbers, or as dates (ISO 8601) since the first. Raises `FileError`."""
    words = [row[cells.header.index("t_s")] for row in cells.rows]
    if any("-" not in word[1:] or "e-" in word.lower() for word in words):
        return cells.numbers("t_s")
    try:
        dates = [datetime.fromisoformat(word) for word in words]
        return np.array([(date - dates[0]).total_seconds() for date in dates])
    except (ValueError, TypeError):
        raise FileError(cells.path, cells.at(0, "t_s"), f"'{words[0]}' is no time", DATES) from None


def without_bad_rows(table: CsvTable, known: KnownColumns, skip: bool) -> CsvTable:
    """The table, all cells of the known columns numbers, and with a notice of the rows left out for that, if `skip`.

    Raises `FileError`: naming every cell that is no number; nothing would be left without their rows.
    """
    faults = sorted(
        (row, column, what)
        for column in table.header
        if column in known.names and column != "t_s"
        for row, what in table.faults(column, column in known.may_be_empty)
    )
    if not faults:
        return table
    bad = sorted({row for row, _, _ in faults})
    count = "1 row" if len(bad) == 1 else f"{len(bad)} rows"
    if not skip:
        row, column, what = faults[0]
        also = enumerate_words([table.at(row, column) for row, column, _ in faults[1:]], LISTED)
        right = f"correct {'it' if len(faults) == 1 else 'them'}, or leave {count} out with --bad-rows skip"
        raise FileError(table.path, table.at(row, column), f"{what}{also and f'; nor are {also}'}", right)
    if len(bad) == len(table.rows):
        raise FileError(table.path, "", "every row has a cell that is no number", "is it the right file?")
    kept = np.setdiff1d(np.arange(len(table.rows)), bad)
    lines = enumerate_words([str(table.lines[row]) for row in bad], LISTED)
    return replace(
        table,
        rows=tuple(table.rows[row] for row in kept),
        lines=tuple(table.lines[row] for row in kept),
        notices=(*table.notices, f"{count} with cells that are no numbers left out: line {lines}"),
    )
