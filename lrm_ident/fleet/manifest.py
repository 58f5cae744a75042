"""Manifest of a fleet: a CSV with one row per arm, its files, and tags such as batch, servo make, age."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from lrm_ident.data.measurement_file.number_table import cell_error, read_csv
from lrm_math.arm.arm_file import shipped_arms
from lrm_math.errors import FileError

OWN = ("data", "arm", "name")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


@dataclass(frozen=True)
class FleetMember:
    """One arm of a fleet.

    Attributes:
        data: its measurements. arm: name of a shipped arm, or path of an arm file; "": the one that the file beside the
            measurements names. tags: (column, cell) of every other column of the manifest.
    """

    name: str
    data: Path
    arm: str
    tags: tuple[tuple[str, str], ...]


def read_manifest(path: Path) -> tuple[FleetMember, ...]:
    """The arms of a manifest, in its order; paths are relative to its folder.

    Columns: `data`; `arm` and `name` where wanted (a name is the data file's if not given); all others are tags.

    Raises `FileError`: no such file, no column `data`, a name that stands twice or that cannot name a file.
    """
    table = read_csv(path, ["data"])
    lower = [column.lower() for column in table.header]
    place = {column: lower.index(column) for column in OWN if column in lower}
    members = []
    for number, row in enumerate(table.rows):
        entries = {column: row[j] for column, j in place.items()}
        if not entries["data"]:
            raise cell_error(table, number, "data", "the cell is empty", "the path of the measurements")
        arm = entries.get("arm", "")
        if arm and arm not in shipped_arms():
            arm = (path.parent / arm).as_posix()
        tags = tuple((column, row[j]) for j, column in enumerate(table.header) if column and lower[j] not in OWN)
        name = entries.get("name") or Path(entries["data"]).stem
        if not NAME.fullmatch(name):
            raise cell_error(table, number, "name", f"'{name}' names no file", "letters, digits, . _ and -")
        members.append(FleetMember(name, path.parent / entries["data"], arm, tags))
    twice = [name for name, count in Counter(member.name for member in members).items() if count > 1]
    if twice:
        raise FileError(path, "", f"two arms are called {twice[0]}", "give each its own in a column name")
    return tuple(members)
