"""Known quantities of a table as numbers in SI units; errors name line and column.

Cells of measurements that are no numbers are all named at once, or their rows are left out where that is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.known_columns import DATES, PoseQuantity
from lrm_ident.data.table_text.csv_file import CsvTable, is_number
from lrm_ident.data.wording import enumerate_words
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.plausibility import implausible_value

LISTED = 8


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Quantities (N, k) of N poses by name, one column for each of theirs, SI; NaN where a cell is empty.

    `cells`: where they come from.
    """

    cells: CsvTable
    quantities: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.cells.rows)

    def __contains__(self, name: str) -> bool:
        return name in self.quantities

    def __getitem__(self, name: str) -> Array:
        return self.quantities[name]

    def column(self, name: str) -> Array | None:
        """(N,), a quantity that has one column; None if it is not stated."""
        return self.quantities[name][:, 0] if name in self else None

    def integers(self, name: str) -> NDArray[np.int64]:
        """(N,), a quantity of one column of whole numbers."""
        return self.quantities[name][:, 0].astype(np.int64)

    def error(self, row: int, column: str, what: str, right: str = "") -> FileError:
        """The error of a cell."""
        return cell_error(self.cells, row, column, what, right)

    def reject(self, bad: NDArray[np.bool_], column: str, what: str) -> None:
        """Raises `FileError` at the first row where `bad` (N,) holds."""
        if bad.any():
            raise self.error(int(np.argmax(bad)), column, what)


def cell_error(cells: CsvTable, row: int, column: str, what: str, right: str = "") -> FileError:
    """The error of a cell."""
    return FileError(cells.path, cell_place(cells, row, column), what, right)


def cell_place(cells: CsvTable, row: int, name: str) -> str:
    """Line of a row, and the file's own name of a column."""
    stated = next((column.stated for column in cells.columns if column.name == name), name)
    return f"line {cells.lines[row]}, column {stated}"


def numbers_of(cells: CsvTable, name: str, may_be_empty: bool = False) -> Array:
    """(N,), one column as finite numbers in our unit, NaN in empty cells if there may be some. Raises `FileError`."""
    values, faults = _parsed(cells, name, may_be_empty)
    for row, what in faults.items():
        raise cell_error(cells, row, name, what)
    return values


def _parsed(cells: CsvTable, name: str, may_be_empty: bool) -> tuple[Array, dict[int, str]]:
    """(N,), one column in our unit, NaN where no finite number stands, and by row what is wrong there.

    An empty cell is wrong unless it may be empty.
    """
    words = _words(cells, name)
    values = np.array([_number(word) for word in words], dtype=np.float64)
    faults = {}
    for row in np.flatnonzero(~np.isfinite(values)).tolist():
        if words[row].strip():
            faults[row] = f"'{words[row]}' is not a {'finite ' if is_number(words[row]) else ''}number"
        elif not may_be_empty:
            faults[row] = "the cell is empty"
    return values * cells.columns[cells.header.index(name)].factor, faults


def _words(cells: CsvTable, name: str) -> list[str]:
    """The cells of a column."""
    j = cells.header.index(name)
    return [row[j] for row in cells.rows]


def _number(word: str) -> float:
    """The number of a cell; NaN where there is none."""
    try:
        return float(word)
    except ValueError:
        return math.nan


def without_bad_rows(cells: CsvTable, known: Sequence[PoseQuantity], skip: bool) -> CsvTable:
    """The table, all cells of the known columns numbers, and with a notice of the rows left out for that, if `skip`.

    Raises `FileError`: naming every cell that is no number; nothing would be left without their rows.
    """
    faults = sorted(
        (row, name, what)
        for name, (_, may_be_empty) in _stated(cells, known).items()
        if name != "t_s"
        for row, what in _parsed(cells, name, may_be_empty)[1].items()
    )
    if not faults:
        return cells
    bad = sorted({row for row, _, _ in faults})
    count = "1 row" if len(bad) == 1 else f"{len(bad)} rows"
    if not skip:
        row, column, what = faults[0]
        also = enumerate_words([cell_place(cells, row, column) for row, column, _ in faults[1:]], LISTED)
        right = f"correct {'it' if len(faults) == 1 else 'them'}, or leave {count} out with --bad-rows skip"
        raise cell_error(cells, row, column, f"{what}{also and f'; nor are {also}'}", right)
    if len(bad) == len(cells.rows):
        raise FileError(cells.path, "", "every row has a cell that is no number", "is it the right file?")
    kept = np.setdiff1d(np.arange(len(cells.rows)), bad)
    lines = enumerate_words([str(cells.lines[row]) for row in bad], LISTED)
    return replace(
        cells,
        rows=tuple(cells.rows[row] for row in kept),
        lines=tuple(cells.lines[row] for row in kept),
        notices=(*cells.notices, f"{count} with cells that are no numbers left out: line {lines}"),
    )


def read_numbers(cells: CsvTable, known: Sequence[PoseQuantity]) -> NumberTable:
    """The known quantities, SI. Raises `FileError`: what is no number or cannot be one, or is stated in part."""
    stated = _stated(cells, known)
    columns = {
        name: _seconds(cells) if name == "t_s" else numbers_of(cells, name, may_be_empty)
        for name, (_, may_be_empty) in stated.items()
    }
    for name, (quantity, _) in stated.items():
        rule, size, values = quantity.rule, quantity.size, columns[name]
        if rule is not None and (wrong := rule.wrong(values)).any():
            raise cell_error(cells, int(np.argmax(wrong)), name, rule.what, rule.right)
        if size is not None and (found := implausible_value(size, values)):
            raise cell_error(cells, found.row, name, found.what, found.right)
    there = [quantity for quantity in known if any(name in columns for name in quantity.columns)]
    return NumberTable(cells, {quantity.name: _together(cells, quantity, columns) for quantity in there})


def _stated(cells: CsvTable, known: Sequence[PoseQuantity]) -> dict[str, tuple[PoseQuantity, bool]]:
    """The columns of known quantities in the file's order: their quantity, and whether their cells may be empty."""
    of = {name: quantity for quantity in known for name in quantity.columns}
    return {
        name: (of[name], of[name].may_be_empty or of[name].unless in cells.header)
        for name in cells.header
        if name in of
    }


def _together(cells: CsvTable, quantity: PoseQuantity, columns: Mapping[str, Array]) -> Array:
    """(N, k), a quantity in SI units. Raises `FileError` if a part of it is missing."""
    names = quantity.columns
    missing = [name for name in names if name not in columns]
    if missing:
        raise FileError(cells.path, "header", f"no column {missing[0]}", f"{', '.join(names)} go together")
    values = np.stack([columns[name] for name in names], axis=1)
    gone = np.isnan(values)
    part = gone & ~gone.all(axis=1, keepdims=True)
    if quantity.whole and part.any():
        j = int(np.argmax(part.any(axis=0)))
        row = int(np.argmax(part[:, j]))
        raise cell_error(cells, row, names[j], f"empty, the rest of the {quantity.name} is not")
    return values * quantity.si


def _seconds(cells: CsvTable) -> Array:
    """(N,), times as numbers, or as dates (ISO 8601) since the first. Raises `FileError`."""
    words = _words(cells, "t_s")
    if any("-" not in word[1:] or "e-" in word.lower() for word in words):
        return numbers_of(cells, "t_s")
    try:
        dates = [datetime.fromisoformat(word) for word in words]
        return np.array([(date - dates[0]).total_seconds() for date in dates])
    except (ValueError, TypeError):
        raise cell_error(cells, 0, "t_s", f"'{words[0]}' is no time", DATES) from None
