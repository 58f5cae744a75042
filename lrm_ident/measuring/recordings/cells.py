"""Cells of an export that has lines of different lengths above its table."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lrm_ident.data.table_text.csv_file import read_text
from lrm_math.arrays import Array
from lrm_math.errors import FileError

Cells = list[list[str]]


def read_cells(path: Path) -> Cells:
    """All lines, empty ones as one empty cell, without spaces around; semicolons or commas. Raises `FileError`."""
    text = read_text(path).text
    delimiter = ";" if text.count(";") > text.count(",") else ","
    try:
        rows = list(csv.reader(text.splitlines(), delimiter=delimiter))
    except csv.Error as error:
        raise FileError(path, "", f"is no table ({error})") from None
    return [[cell.strip() for cell in row] or [""] for row in rows]


def column_numbers(path: Path, rows: Sequence[Sequence[str]], first: int, column: int) -> Array:
    """(N,), one column from the row `first` on, NaN for an empty or a missing cell. Raises `FileError`."""
    out = np.full(len(rows) - first, np.nan)
    for k, row in enumerate(rows[first:]):
        cell = row[column] if column < len(row) else ""
        if not cell:
            continue
        try:
            out[k] = float(cell)
        except ValueError:
            raise FileError(path, f"line {first + k + 1} of the table", f"'{cell}' is not a number") from None
    return out
