"""CSV tables with a header; errors name line and column."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.errors import FileError


@dataclass(frozen=True)
class CsvTable:
    """Cells of a CSV file as text.

    Attributes:
        lines: line number in the file of each row; `header_line`: of the header.
        stated: the file's own names of columns, by ours, where they differ.
        factors: by which the numbers of a column are multiplied, where it is not one.
    """

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    stated: Mapping[str, str] = field(default_factory=dict)
    factors: Mapping[str, float] = field(default_factory=dict)
    header_line: int = 1

    def numbers(self, column: str, may_be_empty: bool = False) -> Array:
        """(N,), one column as finite numbers in our unit, NaN in empty cells if there may be some.

        Raises `FileError`.
        """
        for row, what in self.faults(column, may_be_empty):
            raise FileError(self.path, self.at(row, column), what)
        j = self.header.index(column)
        values = [float(row[j]) if row[j].strip() else math.nan for row in self.rows]
        return np.array(values, dtype=np.float64) * self.factors.get(column, 1.0)

    def at(self, row: int, column: str) -> str:
        """Location of a cell for error messages."""
        return f"line {self.lines[row]}, column {self.stated.get(column, column)}"

    def reject(self, bad: NDArray[np.bool_], column: str, what: str, right: str = "") -> None:
        """Raises `FileError` at the first row where `bad` (N,) holds."""
        if bad.any():
            raise FileError(self.path, self.at(int(np.argmax(bad)), column), what, right)

    def faults(self, column: str, may_be_empty: bool = False) -> Iterator[tuple[int, str]]:
        """Rows whose cell is no finite number, and why; an empty one counts unless it may be empty."""
        j = self.header.index(column)
        for i, row in enumerate(self.rows):
            if what := _fault(row[j], may_be_empty):
                yield i, what

    def take(self, rows: Sequence[int]) -> CsvTable:
        """The table of the given rows."""
        return replace(self, rows=tuple(self.rows[i] for i in rows), lines=tuple(self.lines[i] for i in rows))


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
    header = tuple(ours.get(name.lower(), name) for name in table.header)
    missing = [name for name in required if name not in header]
    if missing:
        raise FileError(table.path, "header", f"missing column {missing[0]}", f"required: {', '.join(required)}")
    twice = [name for name, times in Counter(header).items() if times > 1 and name]
    if twice:
        raise FileError(table.path, "header", f"column {twice[0]} stands twice")
    if not table.rows:
        raise FileError(table.path, "", "no rows below the header")
    return replace(table, header=header)


def csv_text(columns: Iterable[tuple[str, Array, int]]) -> str:
    """CSV text of (name, values (N,), decimals)."""
    named = list(columns)
    head = ",".join(name for name, _, _ in named)
    lines = (
        ",".join(
            "" if math.isnan(value) else f"{value:.{decimals}f}"
            for value, (_, _, decimals) in zip(row, named, strict=True)
        )
        for row in zip(*(values for _, values, _ in named), strict=True)
    )
    return "\n".join([head, *lines]) + "\n"
