"""Known columns of a table as numbers in our units, every cell read and checked once.

Cells that are no numbers are all named at once, or their rows are left out where that is asked for.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.csv_table import CsvTable
from lrm_ident.data.wording import enumerate_words
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.plausibility import PlausibleSize, implausible_value, times

LISTED = 8
ABOVE_ZERO = ("sd_mm", "sx_mm", "sy_mm", "sz_mm", "srot_deg", "distance_mm", "distance_sd_mm")
WHOLE = ("pose", "repeat_of")
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


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Columns (N,) by name; NaN where a cell is empty that may be. `cells`: where they come from."""

    cells: CsvTable
    columns: Mapping[str, Array]

    def __len__(self) -> int:
        return len(self.cells.rows)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def stack(self, names: Sequence[str]) -> Array:
        """(N, k), several columns side by side."""
        return np.stack([self.columns[name] for name in names], axis=1)

    def whole(self, name: str) -> NDArray[np.int64]:
        """(N,), a column of whole numbers."""
        return self.columns[name].astype(np.int64)

    def optional(self, names: Sequence[str]) -> Array | None:
        """(N, k), columns that go together; None without them. Raises `FileError` for a part of them."""
        there = [name for name in names if name in self.columns]
        if there and len(there) < len(names):
            missing = next(name for name in names if name not in self.columns)
            raise self.fault("header", f"no column {missing}", f"{', '.join(names)} go together")
        return self.stack(names) if there else None

    def reject(self, bad: NDArray[np.bool_], name: str, what: str, right: str = "") -> None:
        """Raises `FileError` at the first row where `bad` (N,) holds."""
        self.cells.reject(bad, name, what, right)

    def reject_implausible(self, name: str, quantity: PlausibleSize) -> None:
        """Raises `FileError` at the first row whose value is of no plausible size."""
        found = implausible_value(quantity, self.columns[name])
        if found:
            raise self.fault(self.cells.at(found.row, name), found.what, found.right)

    def reject_gaps(self, names: Sequence[str], whole: str) -> None:
        """Raises `FileError` at the first row of which some of these cells are empty, and some are not."""
        gone = np.isnan(self.stack(names))
        for empty, name in zip(gone.T, names, strict=True):
            self.reject(empty & ~gone.all(axis=1), name, f"empty, the rest of the {whole} is not")

    def fault(self, where: str, what: str, right: str = "") -> FileError:
        """An error of the file; `where`: a header, or a cell by `cells.at`."""
        return FileError(self.cells.path, where, what, right)


def read_numbers(cells: CsvTable, names: Collection[str], may_be_empty: Collection[str] = ()) -> NumberTable:
    """The columns of these names, as far as they are there. Raises `FileError`: what is no number, or cannot be one."""
    columns = {
        name: _seconds(cells) if name == "t_s" else cells.numbers(name, name in may_be_empty)
        for name in cells.header
        if name in names
    }
    for name, values in columns.items():
        if name in ABOVE_ZERO:
            cells.reject(values <= 0, name, "not above zero")
        elif name in WHOLE:
            cells.reject(np.nan_to_num(values) % 1.0 != 0.0, name, "not a whole number")
        elif name == "payload_g":
            cells.reject(values < 0, name, "a negative load")
        elif name.startswith("approach"):
            cells.reject(~np.isin(values, SIDES), name, "not a side", "1, -1, or 0 if unknown")
    table = NumberTable(cells, columns)
    for name in {*columns} & {*PLAUSIBLE}:
        table.reject_implausible(name, PLAUSIBLE[name])
    return table


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


def without_bad_rows(
    table: CsvTable, names: Collection[str], may_be_empty: Collection[str], skip: bool
) -> tuple[CsvTable, tuple[str, ...]]:
    """The table, all cells of these columns numbers, and what was left out for that, if `skip`.

    Raises `FileError`: naming every cell that is no number; nothing would be left without their rows.
    """
    faults = sorted(
        (row, column, what)
        for column in table.header
        if column in names and column != "t_s"
        for row, what in table.faults(column, column in may_be_empty)
    )
    if not faults:
        return table, ()
    bad = sorted({row for row, _, _ in faults})
    if not skip:
        row, column, what = faults[0]
        also = enumerate_words([table.at(row, column) for row, column, _ in faults[1:]], LISTED)
        right = f"correct {'it' if len(faults) == 1 else 'them'}, or leave {_rows(len(bad))} out with --bad-rows skip"
        raise FileError(table.path, table.at(row, column), f"{what}{also and f'; nor are {also}'}", right)
    kept = np.setdiff1d(np.arange(len(table.rows)), bad)
    if not len(kept):
        raise FileError(table.path, "", "every row has a cell that is no number", "is it the right file?")
    lines = enumerate_words([str(table.lines[row]) for row in bad], LISTED)
    return table.take(kept.tolist()), (f"{_rows(len(bad))} with cells that are no numbers left out: line {lines}",)


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count} rows"
