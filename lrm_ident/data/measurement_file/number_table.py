"""Known quantities of a table as numbers in SI units; every error of a cell is found here, and names line and column.

Cells of measurements that are no numbers are all named at once, or their rows are left out where that is asked for.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.pose_quantity import DATES, DISTANCE, PoseQuantity
from lrm_ident.data.measurement_file.session_names import with_numbered_sessions
from lrm_ident.data.measurement_file.times import seconds_of
from lrm_ident.data.table_text.csv_file import CsvTable, is_number, read_table
from lrm_ident.data.wording import enumerate_words
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.plausibility import implausible_value

LISTED, COLUMNS_LISTED = 8, 12
"""Cells that are named beside the first wrong one, and columns that are there beside one that is missing."""
EMPTY = "the cell is empty"
TWO_ANGLES = ("angles", "feedback")
"""Names of the quantities of joint angles: as commanded, and as encoders read them."""
LIMIT_TOLERANCE = np.radians(1e-6)
MISTYPED = 0.1
"""Share of the rows up to which joint angles beyond the limits are single mistakes."""


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Quantities (N, k) of N poses by name, one column for each of theirs, SI; NaN where a cell is empty.

    `cells`: where they come from. `beyond`: row and error of each joint angle beyond the arm's limits.
    """

    cells: CsvTable
    quantities: Mapping[str, Array]
    beyond: tuple[tuple[int, FileError], ...] = ()

    def __len__(self) -> int:
        return len(self.cells.rows)

    def __contains__(self, name: str) -> bool:
        return name in self.quantities

    def __getitem__(self, name: str) -> Array:
        return self.quantities[name]

    def column(self, name: str) -> Array | None:
        """(N,), a quantity that has one column; None if it is not stated."""
        return self.quantities[name][:, 0] if name in self else None

    def words(self, name: str) -> list[str] | None:
        """(N,), the cells of a column of names; None if it is not stated."""
        if name not in self.cells.header:
            return None
        return [cell.strip() for cell in _column(self.cells, name)[0]]

    def integers(self, name: str) -> NDArray[np.int64]:
        """(N,), a quantity of one column of whole numbers."""
        return self.quantities[name][:, 0].astype(np.int64)


def read_csv(path: Path, required: Sequence[str]) -> CsvTable:
    """Reads a CSV file with a header whose names are ours, in any capitals.

    Raises `FileError`: no such file, a missing or doubled column, a row with too few or too many cells, no rows.
    """
    table = _require(read_table(path), required)
    twice = [name for name, count in Counter(table.header).items() if count > 1 and name]
    if twice:
        raise FileError(path, "header", f"column {twice[0]} stands twice")
    return table


def _require(table: CsvTable, required: Sequence[str], hint: str = "") -> CsvTable:
    """The table, its required columns named as requested. Raises `FileError`: a missing column, no rows."""
    ours = {name.lower(): name for name in required}
    columns = tuple(replace(column, name=ours.get(column.name.lower(), column.name)) for column in table.columns)
    named = {column.name for column in columns}
    missing = [name for name in required if name not in named]
    if missing:
        there = enumerate_words([column.name for column in columns if column.name], COLUMNS_LISTED)
        right = f"required: {', '.join(required)}; there are: {there}{hint}"
        where = f"header of the sheet '{table.sheet}'" if table.sheet else "header"
        raise FileError(table.path, where, f"missing column {missing[0]}", right)
    if not table.rows:
        raise FileError(table.path, "", "no rows below the header")
    return replace(table, columns=columns)


def cell_error(cells: CsvTable, row: int, column: str, what: str, right: str = "") -> FileError:
    """The error of a cell."""
    return FileError(cells.path, _cell_place(cells, row, column), what, right)


def _cell_place(cells: CsvTable, row: int, name: str) -> str:
    """Line of a row, and the file's own name of a column."""
    stated = next((column.stated for column in cells.columns if column.name == name), name)
    return f"line {cells.lines[row]}, column {stated}"


def numbers_of(cells: CsvTable, name: str) -> Array:
    """(N,), one column as finite numbers in our unit. Raises `FileError`."""
    values, faults = _parsed(cells, name, may_be_empty=False)
    for row, what in faults.items():
        raise cell_error(cells, row, name, what)
    return values


def _parsed(cells: CsvTable, name: str, may_be_empty: bool) -> tuple[Array, dict[int, str]]:
    """(N,), one column in our unit, NaN where no finite number stands, and by row what is wrong there.

    An empty cell is wrong unless it may be empty.
    """
    words, factor = _column(cells, name)
    if name == "t_s":
        wrong = [row for row, word in enumerate(words) if seconds_of([word]) is None]
        times = _times(words, factor)
        unread = np.full(len(words), math.nan)
        return unread if times is None else times, {row: f"'{words[row]}' is no time" for row in wrong}
    values = np.array([float(word) if is_number(word) else math.nan for word in words], dtype=np.float64)
    faults = {}
    for row in np.flatnonzero(~np.isfinite(values)).tolist():
        if words[row].startswith("="):
            faults[row] = f"'{words[row]}' is a formula without its value: save it in a spreadsheet program"
        elif words[row].strip():
            faults[row] = f"'{words[row]}' is not a {'finite ' if is_number(words[row]) else ''}number"
        elif not may_be_empty:
            faults[row] = EMPTY
    return values * factor, faults


def _times(words: Sequence[str], factor: float) -> Array | None:
    """(N,), times in s: numbers in the column's unit, or dates and times of day; None if they are of no one meaning."""
    seconds = seconds_of(words)
    stated_in_unit = all(is_number(word.strip().lstrip("'")) for word in words)
    return seconds * factor if seconds is not None and stated_in_unit else seconds


def _column(cells: CsvTable, name: str) -> tuple[list[str], float]:
    """The cells of a column, and the factor of their numbers."""
    j = cells.header.index(name)
    return [row[j] for row in cells.rows], cells.columns[j].factor


def read_numbers(cells: CsvTable, quantities: Sequence[PoseQuantity], skip: bool | None = None) -> NumberTable:
    """The known quantities, SI; angles beyond the arm's limits that are within them a full turn away are that.

    Args:
        skip: whether rows with cells that are no numbers are left out, with a notice, instead of all named in one
            error; None: the first one is the error.

    Raises `FileError`: a required column is missing, what is no number or cannot be one, or is stated in part.
    """
    cells = _without_unreadable(with_numbered_sessions(cells), quantities)
    cells = _require(cells, required_columns(cells, quantities), _encoders_alone(cells, quantities))
    header = {*cells.header}
    parsed = {
        name: _parsed(cells, name, each.may_be_empty or not header.isdisjoint(each.unless))
        for each in quantities
        for name in each.columns
        if name in header
    }
    faults = sorted((row, name, what) for name, (_, wrong) in parsed.items() for row, what in wrong.items())
    kept = np.setdiff1d(np.arange(len(cells.rows)), [row for row, _, _ in faults])
    good = _without_faults(cells, quantities, faults, kept, skip) if faults else cells
    columns = {name: values[kept] for name, (values, _) in parsed.items() if name != "t_s"}
    there = [each for each in quantities if not header.isdisjoint(each.columns)]
    table = NumberTable(good, {each.name: _together(good, each, columns) for each in there})
    angles = next((each for each in there if each.limits), None)
    return table if angles is None else _within_limits(table, angles)


def _encoders_alone(cells: CsvTable, quantities: Sequence[PoseQuantity]) -> str:
    """What to do with angles that encoders read, where none are commanded, in words; empty if that is not so."""
    first, read = (next((each.columns[0] for each in quantities if each.name == name), "") for name in TWO_ANGLES)
    if first in cells.header or read not in cells.header:
        return ""
    stated = next(column.stated for column in cells.columns if column.name == read)
    return f"; '{stated}' … is what encoders read: rename it to {first} … only if the arm was commanded there"


def required_columns(cells: CsvTable, quantities: Sequence[PoseQuantity]) -> list[str]:
    """Columns that a table needs beside those that it has."""
    header = {*cells.header}
    wanted = (
        each for each in quantities if each.required and (header.isdisjoint(each.unless) or {*each.columns} & header)
    )
    return [name for each in wanted for name in each.columns]


def _without_unreadable(cells: CsvTable, quantities: Sequence[PoseQuantity]) -> CsvTable:
    """The table without optional quantities of which a column has no number at all, with a notice of each."""
    notices = list(cells.notices)
    columns = cells.columns
    for each in quantities if cells.rows else ():
        if each.required or each.name == "pose":
            continue
        for name in each.columns:
            if name not in cells.header or not _unreadable(cells, name, each.may_be_empty):
                continue
            stated, words = next((c.stated for c in cells.columns if c.name == name), name), _column(cells, name)[0]
            why = f"no cell is a {'time' if name == 't_s' else 'number'}, the first is '{words[0]}'"
            notices.append(f"column {stated} left out: {why}")
            columns = tuple(replace(column, name="") if column.name in each.columns else column for column in columns)
            break
    return replace(cells, columns=columns, notices=tuple(notices))


def _unreadable(cells: CsvTable, name: str, may_be_empty: bool) -> bool:
    """Whether no cell of a column is a finite number, or a time; an empty column whose cells may be empty is not."""
    words, _ = _column(cells, name)
    if name == "t_s":
        return all(seconds_of([word]) is None for word in words)
    return not any(is_number(word) and math.isfinite(float(word)) for word in words) and (
        not may_be_empty or any(word.strip() for word in words)
    )


def _without_faults(
    cells: CsvTable,
    quantities: Sequence[PoseQuantity],
    faults: Sequence[tuple[int, str, str]],
    kept: NDArray[np.int64],
    skip: bool | None,
) -> CsvTable:
    """The rows `kept` alone, with a notice, if bad rows are to be skipped.

    `faults`: row, column, and what is wrong there. Raises `FileError`: naming them all (the first alone where `skip` is
    None), or that nothing would be left.
    """
    row, column, what = faults[0]
    instead = _instead_of_nothing(quantities, faults)
    if skip is None:
        raise cell_error(cells, row, column, what, instead)
    bad = sorted({row for row, _, _ in faults})
    count = "1 row" if len(bad) == 1 else f"{len(bad)} rows"
    if not skip:
        also = enumerate_words([_cell_place(cells, row, column) for row, column, _ in faults[1:]], LISTED)
        also = also and f"; no number either: {also}"
        right = f"correct {'it' if len(faults) == 1 else 'them'}, or leave {count} out with --bad-rows skip"
        if instead:
            also = f", as in {len(faults)} of {len(cells.rows)} rows" if len(faults) > 1 else ""
            right = f"{instead}; or leave {count} out with --bad-rows skip"
        elif not len(kept):
            right = "write numbers alone, their unit in the header (q1_deg, x_mm)"
        raise cell_error(cells, row, column, f"{what}{also}", right)
    if not len(kept):
        raise FileError(cells.path, "", "every row has a cell that is no number", "is it the right file?")
    lines = enumerate_words([str(cells.lines[row]) for row in bad], LISTED)
    notice = f"{count} with cells that are no numbers left out: line {lines}"
    rows, numbers = tuple(cells.rows[row] for row in kept), tuple(cells.lines[row] for row in kept)
    return replace(cells, rows=rows, lines=numbers, notices=(*cells.notices, notice))


def _instead_of_nothing(quantities: Sequence[PoseQuantity], faults: Sequence[tuple[int, str, str]]) -> str:
    """What to write instead of nothing, where all faults (row, column, what) are empty cells of one such column."""
    if {what for _, _, what in faults} != {EMPTY} or len({column for _, column, _ in faults}) > 1:
        return ""
    return next((each.if_empty for each in quantities if faults[0][1] in each.columns), "")


def _together(cells: CsvTable, quantity: PoseQuantity, columns: Mapping[str, Array]) -> Array:
    """(N, k), a quantity in SI units. Raises `FileError` if a part of it is missing, or cannot be."""
    names, rule = quantity.columns, quantity.rule
    missing = [name for name in names if name not in cells.header]
    if missing:
        raise FileError(cells.path, "header", f"no column {missing[0]}", f"{', '.join(names)} go together")
    values = np.stack([columns[name] if name in columns else _seconds(cells) for name in names], axis=1)
    gone = np.isnan(values)
    faults = [
        (gone & ~gone.all(axis=1, keepdims=True) & quantity.whole, f"empty, the rest of the {quantity.name} is not", "")
    ]
    faults += [] if rule is None else [(rule.wrong(values), rule.what, rule.right)]
    for wrong, what, right in faults:
        if wrong.any():
            j, row = np.argwhere(wrong.T)[0].tolist()
            raise cell_error(cells, row, names[j], what, right)
    if quantity.size is not None and (fault := implausible_value(quantity.size, values.T.ravel())):
        raise cell_error(cells, fault.row % len(values), names[fault.row // len(values)], fault.what, fault.right)
    return values * quantity.si * quantity.signs


def _seconds(cells: CsvTable) -> Array:
    """(N,), times as numbers, or since the first. Raises `FileError`."""
    words, factor = _column(cells, "t_s")
    seconds = _times(words, factor)
    if seconds is None:
        raise cell_error(cells, 0, "t_s", f"'{words[0]}' and the others are not times of one meaning", DATES)
    return seconds


def _within_limits(table: NumberTable, angles: PoseQuantity) -> NumberTable:
    """The table with angles beyond the arm's limits a full turn away (260 deg: -100), with a notice, or `beyond`.

    Where more than `MISTYPED` of the rows are beyond, no angle is turned: their unit, or the arm, is another one.
    """
    stated, (low, high) = table[angles.name], np.array(angles.limits).T
    other = stated - np.sign(stated) * 2.0 * np.pi
    outside, away = ((q < low - LIMIT_TOLERANCE) | (q > high + LIMIT_TOLERANCE) for q in (stated, other))
    beyond = []
    for j, row in np.argwhere((outside & away).T).tolist():
        what = f"{np.degrees(stated[row, j]):g} deg is beyond the limits of joint {j + 1}"
        right = "{:g} to {:g} deg".format(*np.degrees(angles.limits[j]))
        beyond.append((row, cell_error(table.cells, row, angles.columns[j], what, right)))
    if len({row for row, _ in beyond}) > MISTYPED * len(table):
        return replace(table, beyond=tuple(beyond))
    turning = outside & ~away
    q, notices = np.where(turning, other, stated), list(table.cells.notices)
    for j in np.flatnonzero(turning.any(axis=0)).tolist():
        row, turned = int(np.argmax(turning[:, j])), int(turning[:, j].sum())
        was, read = np.degrees([stated[row, j], q[row, j]])
        count = "1 angle is" if turned == 1 else f"{turned} angles are"
        notices.append(f"{count} beyond the limits of joint {j + 1} and read a full turn away: {was:g} = {read:g} deg")
    cells, quantities = replace(table.cells, notices=tuple(notices)), {**table.quantities, angles.name: q}
    return NumberTable(cells, quantities, tuple(beyond))


def _numbered_through(table: NumberTable) -> NumberTable:
    """The table with the rows numbered 1, 2, 3 …, with a notice, where each session numbers its own from anew."""
    session = table.column("session")
    if session is None or "repeat_of" in table or len(np.unique(table["pose"])) == len(table):
        return table
    if len(np.unique(np.stack([session, table["pose"][:, 0]], axis=1), axis=0)) < len(table):
        return table
    notice = f"each session has its own pose numbers: the rows are taken as poses 1 to {len(table)}, in their order"
    cells = replace(table.cells, notices=(*table.cells.notices, notice))
    return replace(
        table, cells=cells, quantities={**table.quantities, "pose": np.arange(1.0, len(table) + 1.0)[:, None]}
    )


def _with_numbers_of_rows(table: NumberTable) -> NumberTable:
    """The table with the rows numbered 1, 2, 3 …, with a notice, where rows of one number and the same commanded angles
    have other positions.

    They are not taken as repetitions: another load, session or side of approach may make the difference.
    """
    number, q = table["pose"][:, 0], table["angles"]
    first = np.unique(number, return_index=True)[1][np.unique(number, return_inverse=True)[1].reshape(-1)]
    again = first != np.arange(len(table))
    if "repeat_of" in table or "position" not in table or not again.any() or not (q == q[first]).all():
        return table
    if (table["position"] == table["position"][first])[again].all(axis=1).any():  # copies
        return table
    notice = (
        f"{int(again.sum())} rows have the number and the angles of an earlier one: the rows are taken as poses 1 to "
        f"{len(table)}. Where one only repeats another, name that one in the column repeat_of: it tells the noise"
    )
    cells = replace(table.cells, notices=(*table.cells.notices, notice))
    numbered = {"pose": np.arange(1.0, len(table) + 1.0)[:, None]}
    return replace(table, cells=cells, quantities={**table.quantities, **numbered})


def checked_rows(table: NumberTable) -> NumberTable:
    """The table of measured poses, each with the number of the pose that it repeats, its own where the cell is empty.

    Raises `FileError`: a number that stands twice, a repetition of no pose, or a row without position and distance.
    """
    table = _with_numbers_of_rows(_numbered_through(table))
    cells, pose, first = table.cells, table.integers("pose"), dict[int, int]()
    for row, number in enumerate(pose.tolist()):
        if first.setdefault(number, row) != row:
            what = f"pose {number} stands in line {cells.lines[first[number]]} already"
            right = "each row has its own number; name a repetition in the column repeat_of"
            raise cell_error(cells, row, "pose", what, right)
    stated = table["repeat_of"] if "repeat_of" in table else np.full((len(table), 1), np.nan)
    repeat = np.where(np.isnan(stated), table["pose"], stated)
    unknown = ~np.isin(repeat[:, 0], pose)
    if unknown.any():
        row = int(np.argmax(unknown))
        raise cell_error(cells, row, "repeat_of", f"there is no pose {repeat[row, 0]:.0f}")
    empty = np.isnan(table["distance"][:, 0]) if "distance" in table else np.zeros(len(table), dtype=np.bool_)
    if "position" in table:
        empty &= np.isnan(table["position"][:, 0])
    if empty.any():
        raise cell_error(cells, int(np.argmax(empty)), DISTANCE, "empty, and the row has no position either")
    return replace(table, quantities={**table.quantities, "repeat_of": repeat})
