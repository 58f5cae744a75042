"""Text of a table as spreadsheets and trackers write it: encoding, delimiter, decimal comma, comment lines.

An Excel export may begin with a byte order mark and a line `sep=;`, is UTF-16 if saved as Unicode text, and has decimal
commas and semicolons on computers whose language writes numbers so.
"""

from __future__ import annotations

import csv
import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from lrm_ident.data.csv_table import Column, CsvTable, require
from lrm_ident.data.table_text.workbook import sheet_text
from lrm_math.errors import FileError
from lrm_math.text_file import read_content

DELIMITERS = (";", "\t", ",")
COMMENT = ("#", "%", "//")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")
"""A number with commas that may divide thousands as well."""
PACKED = b"PK\x03\x04"
"""Begin of a packed file, as .xlsx is."""
OLD_EXCEL = b"\xd0\xcf\x11\xe0"
NO_TEXT = re.compile("[\x00-\x08\x0e-\x1f\ufffd]")
TOOL_SCHEMA = re.compile(r"""^\s*"?schema"?\s*[=:]\s*"(lrm/\w+)/""", re.MULTILINE)


def read_csv(path: Path, required: Sequence[str]) -> CsvTable:
    """Reads a CSV file with a header whose names are ours, in any capitals.

    Raises `FileError`: no such file, a missing or doubled column, a row with too few or too many cells, no rows.
    """
    return require(read_table(path), required)


def read_text(path: Path) -> str:
    """Text of a file in one of the encodings of `encoding_of`, or of a workbook's first sheet. Raises `FileError`."""
    return decoded(path, read_content(path))


def decoded(path: Path, content: bytes) -> str:
    """The same of a file's content."""
    if content.startswith(PACKED):
        return sheet_text(path, content)
    if content.startswith(OLD_EXCEL):
        raise FileError(path, "", "an Excel file of before 2007", "save it as .xlsx or as CSV")
    text = content.decode(encoding_of(content), errors="replace")
    if NO_TEXT.search(text):
        raise FileError(path, "", "is no text", "a table: CSV, or an Excel workbook (.xlsx)")
    return text


def encoding_of(content: bytes) -> str:
    """UTF-16 if its byte order mark is there; else UTF-8, or Windows-1252 (Latin-1 and more) if it is not that."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    try:
        content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def read_table(path: Path) -> CsvTable:
    """Reads a table with a header, its columns named as in the file, its numbers with decimal points.

    Blank lines, comment lines and empty columns at the right are left out. Raises `FileError`: nothing in it, another
    kind of file, a row with more or fewer cells than the header, or commas that may mean two things.
    """
    content = read_content(path)
    text = decoded(path, content)
    if schema := TOOL_SCHEMA.search(text):
        what = f"is a file of the schema {schema[1]}, no table"
        raise FileError(path, "", what, "the data are a CSV: do the arguments stand in another order?")
    lines = text.splitlines()
    delimiter = _stated_delimiter(lines)
    kept = [(number, line) for number, line in enumerate(lines, start=1) if _tells(line)]
    if not kept:
        raise FileError(path, "", "is empty", "a header that names the columns (pose, q1_deg, …), and a row per pose")
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
    header, *cut = (row[:width] for row in rows)
    table = CsvTable(
        path,
        tuple(Column(name, name) for name in header),
        tuple(cut),
        tuple(numbers[1:]),
        header_line=numbers[0],
        sha256=hashlib.sha256(content).hexdigest(),
        notices=tuple(_notices(content)),
    )
    return table if delimiter == "," else _with_points(table)


def _notices(content: bytes) -> Iterator[str]:
    """Notices of how a file was read."""
    if content.startswith(PACKED):
        yield "read from the first sheet of the workbook"
        return
    if encoding_of(content) == "cp1252":
        yield "read as Windows-1252 (Latin-1), as it is not UTF-8"
    if not content.endswith(b"\n"):
        yield "the last line does not end; is the file complete?"


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


def _with_points(table: CsvTable) -> CsvTable:
    """The table with decimal points for decimal commas. Raises `FileError` if its commas may divide thousands."""
    cells = [(line, cell) for row, line in zip(table.rows, table.lines, strict=True) for cell in row if "," in cell]
    both = next(((line, cell) for line, cell in cells if "." in cell), None)
    if both:
        what, right = f"'{both[1]}' has a comma and a point", "write numbers without commas for thousands"
        raise FileError(table.path, f"line {both[0]}", what, right)
    numeric = [(line, cell) for line, cell in cells if DECIMAL_COMMA.fullmatch(cell)]
    if not numeric:
        return table
    points = any("." in cell and _is_number(cell) for row in table.rows for cell in row)
    if points or all(THOUSANDS.fullmatch(cell) for _, cell in numeric):
        line, cell = numeric[0]
        why = (
            "other numbers of the file have a decimal point"
            if points
            else "every comma of the file may divide thousands"
        )
        what = f"'{cell}': a decimal comma or thousands? {why}"
        raise FileError(table.path, f"line {line}", what, "write it with a decimal point")
    rows = (
        tuple(cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell) else cell for cell in row) for row in table.rows
    )
    return replace(table, rows=tuple(rows))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
