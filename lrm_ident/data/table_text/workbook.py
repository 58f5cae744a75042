"""First sheet of an Excel workbook (.xlsx: Office Open XML, ECMA-376) as the text of a CSV file."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from datetime import datetime, timedelta
from functools import reduce
from pathlib import Path
from xml.etree import ElementTree
from zipfile import BadZipFile, ZipFile

from lrm_math.errors import FileError

SPACE = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
RELATION = "{http://schemas.openxmlformats.org/officeDocument/2006/relationships}id"
DAY_ZERO = datetime(1899, 12, 30)
DATES = {*range(14, 23), *range(45, 48)}
"""Numbers of the built-in formats of dates and times."""
LARGEST = 200 << 20
"""Bytes of an unpacked part that are read."""


def sheet_text(path: Path, content: bytes) -> str:
    """CSV text of the first sheet, its rows on the lines of their numbers; dates in ISO 8601.

    Raises `FileError`: no workbook, or a damaged one.
    """
    try:
        with ZipFile(io.BytesIO(content)) as parts:
            if any(part.file_size > LARGEST for part in parts.infolist()):
                raise FileError(path, "", "the workbook is too large", "save the sheet as CSV")
            shared, dates = list(_shared(parts)), _date_styles(parts)
            first = _part(parts, "xl/workbook.xml").find(f"{SPACE}sheets/{SPACE}sheet")
            own = None if first is None else first.get(RELATION)
            links = {link.get("Id"): link.get("Target", "") for link in _part(parts, "xl/_rels/workbook.xml.rels")}
            name = links[own]
            sheet = _part(parts, name.lstrip("/") if name.startswith("/") else f"xl/{name}")
    except (BadZipFile, KeyError, ElementTree.ParseError, ValueError, IndexError) as error:
        raise FileError(
            path, "", f"looks packed, but is no readable Excel workbook ({error})", "save it as CSV"
        ) from None
    return _text(dict(_rows(sheet, shared, dates)))


def _part(parts: ZipFile, name: str) -> ElementTree.Element:
    return ElementTree.fromstring(parts.read(name))


def _shared(parts: ZipFile) -> Iterator[str]:
    if "xl/sharedStrings.xml" in parts.namelist():
        for item in _part(parts, "xl/sharedStrings.xml"):
            yield "".join(text.text or "" for text in item.iter(f"{SPACE}t"))


def _date_styles(parts: ZipFile) -> set[str]:
    """Styles of cells that show their number as a date."""
    if "xl/styles.xml" not in parts.namelist():
        return set()
    styles = _part(parts, "xl/styles.xml")
    own = {int(f.get("numFmtId", 0)): f.get("formatCode", "") for f in styles.iter(f"{SPACE}numFmt")}
    dated = DATES | {
        number for number, code in own.items() if re.search("[dyhs]", re.sub(r'"[^"]*"|\[[^]]*]|\\.', "", code))
    }
    cells = styles.find(f"{SPACE}cellXfs")
    return {
        str(i) for i, cell in enumerate(cells if cells is not None else ()) if int(cell.get("numFmtId", 0)) in dated
    }


def _rows(sheet: ElementTree.Element, shared: list[str], dates: set[str]) -> Iterator[tuple[int, dict[int, str]]]:
    for count, row in enumerate(sheet.iter(f"{SPACE}row"), start=1):
        cells = {}
        for place, cell in enumerate(row.iter(f"{SPACE}c")):
            letters = re.match("[A-Z]+", cell.get("r", ""))
            cells[_column(letters[0]) if letters else place] = _value(cell, shared, dates)
        yield int(row.get("r", count)), cells


def _column(letters: str) -> int:
    return reduce(lambda number, letter: number * 26 + ord(letter) - ord("A") + 1, letters, 0) - 1


def _value(cell: ElementTree.Element, shared: list[str], dates: set[str]) -> str:
    kind = cell.get("t", "n")
    if kind == "inlineStr":
        return " ".join("".join(text.text or "" for text in cell.iter(f"{SPACE}t")).split())
    value = cell.findtext(f"{SPACE}v", "")
    if kind == "s":
        return " ".join(shared[int(value)].split())
    if kind == "n" and value and cell.get("s") in dates:
        return (DAY_ZERO + timedelta(days=float(value))).isoformat(timespec="milliseconds")
    return value


def _text(rows: dict[int, dict[int, str]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    width = 1 + max((column for row in rows.values() for column in row), default=0)
    for number in range(1, max(rows, default=0) + 1):
        writer.writerow([rows.get(number, {}).get(column, "") for column in range(width)])
    return out.getvalue()
