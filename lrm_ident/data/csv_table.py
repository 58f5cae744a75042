"""CSV tables with a header; errors name line and column."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.errors import FileError


@dataclass(frozen=True)
class CsvTable:
    """Cells of a CSV file as text. `lines[i]`: line number of row i in the file."""

    path: Path
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    def numbers(self, column: str) -> Array:
        """(N,), one column as finite numbers. Raises `FileError`."""
        j = self.header.index(column)
        return np.array([self._number(i, column, row[j]) for i, row in enumerate(self.rows)], dtype=np.float64)

    def at(self, row: int, column: str) -> str:
        """Location of a cell for error messages."""
        return f"line {self.lines[row]}, column {column}"

    def reject(self, bad: NDArray[np.bool_], column: str, what: str, right: str = "") -> None:
        """Raises `FileError` at the first row where `bad` (N,) holds."""
        if bad.any():
            raise FileError(self.path, self.at(int(np.argmax(bad)), column), what, right)

    def _number(self, row: int, column: str, cell: str) -> float:
        try:
            value = float(cell)
        except ValueError:
            what = f"'{cell}' is not a number" if cell.strip() else "the cell is empty"
            raise FileError(self.path, self.at(row, column), what) from None
        if not math.isfinite(value):
            raise FileError(self.path, self.at(row, column), f"'{cell}' is not a finite number")
        return value


def read_csv(path: Path, required: Sequence[str]) -> CsvTable:
    """Reads a CSV file with a header.

    Raises `FileError`: no such file, a missing or doubled column, a row with too few or too many cells, no rows.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise FileError(path, "", "no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(path, "", f"cannot be read as text ({error})") from None
    reader = csv.reader(text.splitlines())
    header = tuple(name.strip() for name in next(reader, []))
    missing = [name for name in required if name not in header]
    if missing:
        raise FileError(path, "header", f"missing column {missing[0]}", f"required: {', '.join(required)}")
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise FileError(path, "header", f"column {twice[0]} stands twice")
    rows, lines = [], []
    for row in reader:
        if row:
            if len(row) != len(header):
                what = f"{len(row)} cells, the header has {len(header)}"
                raise FileError(path, f"line {reader.line_num}", what, "is the file cut off or a comma missing?")
            rows.append(tuple(row))
            lines.append(reader.line_num)
    if not rows:
        raise FileError(path, "", "no rows below the header")
    return CsvTable(path, header, tuple(rows), tuple(lines))


def csv_text(columns: Iterable[tuple[str, Array, int]]) -> str:
    """CSV text of (name, values (N,), decimals)."""
    named = list(columns)
    head = ",".join(name for name, _, _ in named)
    lines = (
        ",".join(f"{value:.{decimals}f}" for value, (_, _, decimals) in zip(row, named, strict=True))
        for row in zip(*(values for _, values, _ in named), strict=True)
    )
    return "\n".join([head, *lines]) + "\n"
