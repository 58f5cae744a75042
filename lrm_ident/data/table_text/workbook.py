"""The sheets of an Excel workbook (.xlsx: Office Open XML, ECMA-376) as texts of CSV files."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import reduce
from pathlib import Path
from xml.etree import ElementTree
from zipfile import BadZipFile, ZipFile

from lrm_ident.data.wording import enumerate_words
from lrm_math.errors import FileError

DAY_ZERO = datetime(1899, 12, 30)
DATES = {*range(14, 23), *range(45, 48)}
"""Numbers of the built-in formats of dates and times."""
NUMBER = re.compile(r"[+-]?\d*[.,]?\d+(?:[eE][+-]?\d+)?")
JOINT = re.compile(r"\s*(q|j|joint|axis|servo|theta)[ _]?\d", re.IGNORECASE)
LARGEST = 200 << 20
"""Bytes of an unpacked part that are read."""
LISTED = 8
"""Hidden rows, and sheets that are not read, which are named."""
WITHOUT_VALUE = "=…"
"""Of a formula that repeats another one and was never calculated."""


@dataclass(frozen=True)
class Sheet:
    """A sheet: its cells by row, from 1, and column, from 0. `hidden`: whether the workbook hides it.
    `hidden_rows`: numbers of the rows with cells that it hides."""

    name: str
    hidden: bool
    rows: Mapping[int, Mapping[int, str]]
    hidden_rows: tuple[int, ...]

    @property
    def numbers(self) -> bool:
        """Whether a row has two numbers at least, as every table of measurements has."""
        return any(sum(map(_is_number, cells.values())) > 1 for cells in self.rows.values())

    @property
    def names_joints(self) -> bool:
        """Whether a cell is a name of a joint with its number, as in a header of joint angles."""
        return any(JOINT.match(cell) for cells in self.rows.values() for cell in cells.values())

    @property
    def likely(self) -> tuple[bool, bool, bool]:
        """By which of two sheets the table of measurements is likelier in the greater one."""
        return self.numbers and not self.hidden, self.numbers and self.names_joints, self.numbers

    def notices(self, others: Sequence[Sheet]) -> tuple[str, ...]:
        """What a person should know of a table that was read from this sheet, not from others of the workbook."""
        left = [f"'{sheet.name}'" for sheet in others if sheet is not self and sheet.rows]
        read = f"read from the sheet '{self.name}'" + (f"; not read: {enumerate_words(left, LISTED)}" if left else "")
        if not self.hidden_rows:
            return (read,)
        hidden = enumerate_words([str(number) for number in self.hidden_rows], LISTED)
        return read, f"rows that the sheet hides are read, too: line {hidden}; delete them if they do not count"

    @property
    def text(self) -> str:
        """CSV text, the rows on the lines of their numbers."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        width = 1 + max((column for row in self.rows.values() for column in row), default=0)
        for number in range(1, max(self.rows, default=0) + 1):
            writer.writerow([self.rows.get(number, {}).get(column, "") for column in range(width)])
        return out.getvalue()


def sheets_of(path: Path, content: bytes) -> tuple[Sheet, ...]:
    """The sheets with cells, the likeliest first: shown with numbers, of these those that name joints, else in order.

    Dates are in ISO 8601.

    Raises `FileError`: no workbook, or a damaged one.
    """
    try:
        with ZipFile(io.BytesIO(content)) as parts:
            if any(part.file_size > LARGEST for part in parts.infolist()):
                raise FileError(path, "", "the workbook is too large", "save the sheet as CSV")
            sheets = [*_sheets(parts)]
    except (BadZipFile, KeyError, ElementTree.ParseError, ValueError, IndexError) as error:
        raise FileError(
            path, "", f"looks packed, but is no readable Excel workbook ({error})", "save it as CSV"
        ) from None
    if not sheets:
        raise FileError(path, "", "the workbook has no sheet with cells", "a header, and a row per pose")
    return tuple(sorted(sheets, key=lambda sheet: sheet.likely, reverse=True))


def _sheets(parts: ZipFile) -> Iterator[Sheet]:
    """The sheets of a workbook that have cells, in its order."""
    shared, dates = [*_shared(parts)], _date_styles(parts)
    links = {link.get("Id"): link.get("Target", "") for link in _part(parts, "xl/_rels/workbook.xml.rels")}
    for sheet in _part(parts, "xl/workbook.xml").iterfind("sheets/sheet"):
        relation_id = next((value for key, value in sheet.items() if key.endswith("}id")), None)
        root = _part(
            parts, links[relation_id].lstrip("/") if links[relation_id].startswith("/") else f"xl/{links[relation_id]}"
        )
        if root.tag != "worksheet":  # a chart
            continue
        rows = [*_rows(root, shared, dates)]
        hidden = tuple(number for number, cells, is_hidden in rows if is_hidden and any(cells.values()))
        cells_of = {number: cells for number, cells, _ in rows}
        yield Sheet(sheet.get("name", ""), sheet.get("state", "visible") != "visible", cells_of, hidden)


def _is_number(cell: str) -> bool:
    return NUMBER.fullmatch(cell) is not None


def _part(parts: ZipFile, name: str) -> ElementTree.Element:
    """A part with the names of its elements alone: their namespace differs in strict Open XML."""
    root = ElementTree.fromstring(parts.read(name))
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    return root


def _shared(parts: ZipFile) -> Iterator[str]:
    if "xl/sharedStrings.xml" in parts.namelist():
        for item in _part(parts, "xl/sharedStrings.xml"):
            yield "".join(text.text or "" for text in item.iter("t"))


def _date_styles(parts: ZipFile) -> set[str]:
    """Styles of cells that show their number as a date."""
    if "xl/styles.xml" not in parts.namelist():
        return set()
    styles = _part(parts, "xl/styles.xml")
    formats = {int(f.get("numFmtId", 0)): f.get("formatCode", "") for f in styles.iter("numFmt")}
    dated = DATES | {
        number for number, code in formats.items() if re.search("[dyhs]", re.sub(r'"[^"]*"|\[[^]]*]|\\.', "", code))
    }
    cells = styles.find("cellXfs")
    return {
        str(i) for i, cell in enumerate(cells if cells is not None else ()) if int(cell.get("numFmtId", 0)) in dated
    }


def _rows(sheet: ElementTree.Element, shared: list[str], dates: set[str]) -> Iterator[tuple[int, dict[int, str], bool]]:
    """Number of each row, its cells by column, and whether it is hidden."""
    for count, row in enumerate(sheet.iter("row"), start=1):
        cells = {}
        for place, cell in enumerate(row.iter("c")):
            letters = re.match("[A-Z]+", cell.get("r", ""))
            cells[_column(letters[0]) if letters else place] = _value(cell, shared, dates)
        yield int(row.get("r", count)), cells, row.get("hidden") in ("1", "true")


def _column(letters: str) -> int:
    return reduce(lambda number, letter: number * 26 + ord(letter) - ord("A") + 1, letters, 0) - 1


def _value(cell: ElementTree.Element, shared: list[str], dates: set[str]) -> str:
    kind = cell.get("t", "n")
    if kind == "inlineStr":
        return " ".join("".join(text.text or "" for text in cell.iter("t")).split())
    value = cell.findtext("v", "")
    if not value and (formula := cell.find("f")) is not None:
        return f"={formula.text}" if formula.text else WITHOUT_VALUE
    if kind == "s":
        return " ".join(shared[int(value)].split())
    if kind == "n" and value and cell.get("s") in dates:
        return (DAY_ZERO + timedelta(days=float(value))).isoformat(timespec="milliseconds")
    return value
