"""Rows with cells that are no numbers: all are named at once, or left out where that is asked for."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from lrm_ident.data.csv_table import CsvTable
from lrm_ident.data.wording import enumerate_words
from lrm_math.errors import FileError
from lrm_math.model.reading import Reading

LISTED = 8


def without_bad_rows(
    table: CsvTable, names: Collection[str], may_be_empty: Collection[str], how: Reading
) -> tuple[CsvTable, tuple[str, ...]]:
    """The table, all cells of these columns numbers, and what was left out for that, where the reading asks for it.

    Raises `FileError`: naming every cell that is no number; nothing is left if their rows are left out.
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
    if how.bad_rows != "skip":
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
