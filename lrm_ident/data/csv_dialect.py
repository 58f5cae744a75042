"""Text of a table as spreadsheets and trackers write it: encoding, delimiter, decimal comma, comment lines.

An Excel export may begin with a byte order mark and a line `sep=;`, is UTF-16 if saved as Unicode text, and has decimal
commas and semicolons on computers whose language writes numbers so.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

from lrm_math.errors import FileError

DELIMITERS = (";", "\t", ",")
COMMENT = ("#", "%", "//")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")
"""A number with commas that may divide thousands as well."""


@dataclass(frozen=True)
class RawTable:
    """Cells of a table, numbers with decimal points. `lines`: their line numbers in the file, the header's first."""

    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]


def read_text(path: Path) -> str:
    """Text of a file in UTF-8, or in UTF-16 if it begins with its byte order mark. Raises `FileError`."""
    try:
        content = path.read_bytes()
        return content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
    except FileNotFoundError:
        raise FileError(path, "", "no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(path, "", f"cannot be read as text ({error})") from None


def parse_table(path: Path, text: str) -> RawTable:
    """Header and rows; blank lines, comment lines and empty columns at the right are left out.

    Raises `FileError`: a row with more or fewer cells than the header, or commas that may mean two things.
    """
    lines = text.splitlines()
    delimiter = _stated_delimiter(lines)
    kept = [(number, line) for number, line in enumerate(lines, start=1) if _tells(line)]
    if not kept:
        return RawTable(((),), (1,))
    delimiter = delimiter or next((mark for mark in DELIMITERS if mark in kept[0][1]), ",")
    if all(_is_number(cell.replace(",", ".")) for cell in kept[0][1].split(delimiter)):
        kept.insert(0, _header_in_comment(path, lines, *kept[0], delimiter))
    rows, numbers = [], []
    for number, line in kept:
        cells = tuple(cell.strip() for cell in next(csv.reader([line], delimiter=delimiter)))
        if any(cells):
            rows.append(cells)
            numbers.append(number)
    width = len(rows[0]) if rows else 0
    while width and not rows[0][width - 1] and all(not any(row[width - 1 :]) for row in rows):
        width -= 1
    for row, number in zip(rows, numbers, strict=True):
        if len(row) < width or any(row[width:]):
            right = "is the file cut off or a comma missing?"
            if delimiter == "," and len(row) == 2 * width:
                right = "are these decimal commas? then divide the cells by semicolons or tabs"
            raise FileError(path, f"line {number}", f"{len(row)} cells, the header has {width}", right)
    table = RawTable(tuple(row[:width] for row in rows), tuple(numbers))
    return table if delimiter == "," else _with_points(path, table)


def _stated_delimiter(lines: list[str]) -> str | None:
    """Delimiter of Excel's first line `sep=;`."""
    first = lines[0].strip().strip('"') if lines else ""
    return first[4:5] if first.lower().startswith("sep=") and len(first) == 5 else None


def _tells(line: str) -> bool:
    bare = line.strip().strip('"')
    return bool(bare) and not bare.startswith(COMMENT) and not bare.lower().startswith("sep=")


def _header_in_comment(path: Path, lines: list[str], first: int, row: str, delimiter: str) -> tuple[int, str]:
    """The comment line just above the first row, if it names as many columns. Raises `FileError`."""
    above = lines[first - 2].strip() if first > 1 else ""
    names = above.lstrip("#%/ ")
    if above.startswith(COMMENT) and names.count(delimiter) == row.count(delimiter):
        return first - 1, names
    raise FileError(
        path, f"line {first}", "numbers, but no header", "name the columns in the first line: pose, q1_deg, …"
    )


def _with_points(path: Path, table: RawTable) -> RawTable:
    """The table with decimal points for decimal commas. Raises `FileError` if its commas may divide thousands."""
    cells = [
        (line, cell) for row, line in zip(table.rows[1:], table.lines[1:], strict=True) for cell in row if "," in cell
    ]
    both = next(((line, cell) for line, cell in cells if "." in cell), None)
    if both:
        raise FileError(
            path,
            f"line {both[0]}",
            f"'{both[1]}' has a comma and a point",
            "write numbers without commas for thousands",
        )
    numeric = [(line, cell) for line, cell in cells if DECIMAL_COMMA.fullmatch(cell)]
    if not numeric:
        return table
    points = any("." in cell and _is_number(cell) for row in table.rows[1:] for cell in row)
    if points or all(THOUSANDS.fullmatch(cell) for _, cell in numeric):
        line, cell = numeric[0]
        why = (
            "other numbers of the file have a decimal point"
            if points
            else "every comma of the file may divide thousands"
        )
        raise FileError(
            path, f"line {line}", f"'{cell}': a decimal comma or thousands? {why}", "write it with a decimal point"
        )
    rows = (
        tuple(cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell) else cell for cell in row)
        for row in table.rows[1:]
    )
    return RawTable((table.rows[0], *rows), table.lines)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
