"""Tables of measurements and poses, columns named as ours whatever the file calls them."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from lrm_ident.data.apply_reading import ANGLE_UNITS, LENGTH_UNITS
from lrm_ident.data.column_names import ColumnName, bare_names, column_name, joint_names, unit_word
from lrm_ident.data.csv_table import CsvTable, read_table
from lrm_math.arm.arm_file import MM
from lrm_math.errors import FileError
from lrm_math.model.reading import AS_NAMED, Reading

POSITION = ("x_mm", "y_mm", "z_mm")
NO_UNIT = ("-", "1", "#")
"""Cells of a row of units below columns that have none."""
ANGLES = re.compile(r"q\d+_deg")


def read_measurement_table(path: Path, how: Reading = AS_NAMED, joints: Sequence[str] = ()) -> CsvTable:
    """Reads a table: columns named as ours, in the units that `how` states in place of those of their names; poses
    numbered 1, 2, 3 … where no column does it.

    `joints`: the arm's own names of its joints, which are names of columns too.

    Raises `FileError`: two columns that are the same by name.
    """
    table = _numbered(_from_zero(_named(_with_units(read_table(path), joints), joints)))
    factors: dict[str, float] = {}
    if how.unit:
        factors |= dict.fromkeys((*POSITION, "distance_mm"), LENGTH_UNITS[how.unit] / MM)
    if how.angle_unit:
        names = [name for name in table.header if ANGLES.fullmatch(name)]
        factors |= dict.fromkeys(names, ANGLE_UNITS[how.angle_unit] / ANGLE_UNITS["deg"])
    return table.with_factors(factors)


def _named(table: CsvTable, joints: Sequence[str]) -> CsvTable:
    """The table with our names of its columns; the joints' own names count if all of them are there."""
    if not all(joints) or not {*joint_names(joints)} <= {words for name in table.header for words in bare_names(name)}:
        joints = ()
    found = [ColumnName(name) if _is_ours(name) else column_name(name, joints) for name in table.header]
    exact = {column.name for column, name in zip(found, table.header, strict=True) if column and column.name == name}
    same: defaultdict[str, list[str]] = defaultdict(list)
    columns: list[ColumnName | None] = []
    for column, name in zip(found, table.header, strict=True):
        beside = column is not None and name != column.name and column.name in exact and not _is_measured(column.name)
        columns.append(None if beside else column)
        if column and not beside:
            same[column.name].append(name)
    for ours, names in same.items():
        if len(names) > 1:
            which = (
                f"column {names[0]} stands twice" if len(set(names)) == 1 else f"{' and '.join(names)} are both {ours}"
            )
            raise FileError(table.path, f"header, line {table.header_line}", which, "leave one, or rename the other")
    return replace(
        table,
        header=tuple(column.name if column else name for column, name in zip(columns, table.header, strict=True)),
        stated={c.name: name for c, name in zip(columns, table.header, strict=True) if c and c.name != name},
        factors={column.name: column.factor for column in columns if column and column.factor != 1.0},
    )


def _with_units(table: CsvTable, joints: Sequence[str]) -> CsvTable:
    """The table with the units of a first row of nothing but units in the names of its columns.

    Raises `FileError`: a name states another unit.
    """
    words = ["" if cell.strip("[]()") in NO_UNIT else cell for cell in table.rows[0]] if table.rows else []
    units = [unit_word(word) for word in words]
    if not any(units) or any(word and not unit for word, unit in zip(words, units, strict=True)):
        return table
    header = []
    for name, unit in zip(table.header, units, strict=True):
        known = column_name(name, joints)
        own = known.unit if known else unit_word(name.rpartition("_")[2])
        if unit and own and own != unit:
            right = "leave the row of units out, or correct it"
            raise FileError(table.path, f"line {table.lines[0]}, column {name}", f"its unit is stated as {unit}", right)
        header.append(f"{name} [{unit}]" if unit and not own else name)
    return replace(table, header=tuple(header), rows=table.rows[1:], lines=table.lines[1:])


def _numbered(table: CsvTable) -> CsvTable:
    """The table with a column `pose`: 1, 2, 3 … if it has none."""
    if "pose" in table.header:
        return table
    rows = tuple((str(number), *row) for number, row in enumerate(table.rows, start=1))
    return replace(table, header=("pose", *table.header), rows=rows)


def _is_ours(name: str) -> bool:
    return _is_measured(name) or name == "pose"


def _is_measured(name: str) -> bool:
    return name in POSITION or ANGLES.fullmatch(name) is not None


def _from_zero(table: CsvTable) -> CsvTable:
    """The table with joints numbered from 1 if the file numbers them from 0."""
    if "q0_deg" not in table.header:
        return table

    def shifted(name: str) -> str:
        return f"q{int(name[1:-4]) + 1}_deg" if ANGLES.fullmatch(name) else name

    stated = {**{name: name for name in table.header if ANGLES.fullmatch(name)}, **table.stated}
    return replace(
        table,
        header=tuple(map(shifted, table.header)),
        stated={shifted(ours): name for ours, name in stated.items()},
        factors={shifted(ours): factor for ours, factor in table.factors.items()},
    )
