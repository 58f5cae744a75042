"""Tables with a header, as spreadsheets and trackers write them: encoding, delimiter, decimal comma, comment lines.

An Excel export may begin with a byte order mark or a line `sep=;`, is UTF-16 if saved as Unicode text, and has decimal
commas and semicolons on computers whose language writes numbers so. Of a workbook the first sheet with
numbers is read.
"""

from __future__ import annotations

import csv
import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from lrm_ident.data.table_text.other_kinds import check_is_file, check_is_table
from lrm_ident.data.table_text.workbook import sheets_of
from lrm_ident.data.wording import enumerate_words
from lrm_math.errors import FileError
from lrm_math.text_file import read_content

PACKED = b"PK\x03\x04"
"""Begin of a packed file, as .xlsx is."""
OLD_EXCEL = b"\xd0\xcf\x11\xe0"
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
NO_TEXT = re.compile("[\x00-\x08\x0e-\x1f\ufffd]")
DELIMITERS = (";", "\t", ",", "|")
COMMENT = ("#", "%", "//")
MOST_LINES_OF_A_ROW = 40
LISTED = 8
"""Lines that are named of those that are left out."""
TYPOGRAPHIC_MINUS = re.compile(r"(?<![^\s,;\"'])[\u2212\u2013](?=[.,]?\d)")
"""A minus sign or an en dash at the beginning of a cell, before a number, as word processors and web pages write it."""
NUMBER = re.compile(r"[+-]?[\d.,]*\d[\d.,]*(?:[eE][+-]?\d+)?")
"""A number with points and commas, whatever they mean."""
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")
"""A number with commas that may divide thousands as well."""
COMMA_AND_POINT = re.compile(r"[+-]?\d{1,3}(?:(?:,\d{3})+\.|(?:\.\d{3})+,)\d*")
"""A number with both, one of which divides thousands; 01.02,2024 is none."""
RECORDING = re.compile(r"\s*(Format Version|(?:Objects|Segments|Trajectories)(?=[,;\s]*\n)|fr[ \t]+\d+(?=\s*\n))")
"""Begin of a tracker's recording that is no table with one header (`measuring.recordings.readers`)."""
TOOL_SCHEMA = re.compile(r"""^\s*"?schema"?\s*[=:]\s*"(lrm/\w+)/""", re.MULTILINE)


@dataclass(frozen=True)
class FileText:
    """Text of a file; `sha256`: of its bytes. `notices`: what a person should know of how it was read.

    `sheet`: name of the one of a workbook that it is; empty: the file is no workbook.
    """

    text: str
    sha256: str
    notices: tuple[str, ...]
    sheet: str = ""


@dataclass(frozen=True)
class Column:
    """A column: its `name`, the file's own name `stated`, and the `factor` by which its numbers are multiplied."""

    name: str
    stated: str
    factor: float = 1.0


@dataclass(frozen=True)
class CsvTable:
    """Cells of a CSV file as text.

    Attributes:
        lines: line number in the file of each row; `header_line`: of the header.
        sha256: of the file. notices: what a person should know of its text. sheet: as in `FileText`.
    """

    path: Path
    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    header_line: int = 1
    sha256: str = ""
    notices: tuple[str, ...] = ()
    sheet: str = ""

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)

    def once(self) -> CsvTable:
        """The table without rows that equal an earlier one in every cell, and a notice of them."""
        first = dict(zip(self.rows[::-1], self.lines[::-1], strict=True))
        kept = [(row, line) for row, line in zip(self.rows, self.lines, strict=True) if first[row] == line]
        again = [str(line) for row, line in zip(self.rows, self.lines, strict=True) if first[row] != line]
        if not again:
            return self
        same = f"line {enumerate_words(again, LISTED)}: the same in every cell as an earlier line, left out"
        notice = f"{same}; what was measured again needs a number of its own, and repeat_of"
        rows, lines = tuple(row for row, _ in kept), tuple(line for _, line in kept)
        return replace(self, rows=rows, lines=lines, notices=(*self.notices, notice))

    def without(self, cells: tuple[str, ...]) -> CsvTable:
        """The table without the rows of these cells."""
        kept = [(row, line) for row, line in zip(self.rows, self.lines, strict=True) if row != cells]
        return replace(self, rows=tuple(row for row, _ in kept), lines=tuple(line for _, line in kept))


def read_text(path: Path) -> FileText:
    """Text in UTF-8, in UTF-16 with its mark, or else in Windows-1252 (Latin-1 and more); of a workbook the likeliest
    sheet. Raises `FileError`."""
    return _texts(path)[0]


def _texts(path: Path) -> tuple[FileText, ...]:
    """The text of a file, or those of the sheets of a workbook that may have its table. Raises `FileError`."""
    check_is_file(path)
    content = read_content(path)
    check_is_table(path, content)
    sha256 = hashlib.sha256(content).hexdigest()
    if content.startswith(PACKED):
        first, *others = sheets = sheets_of(path, content)
        chosen = [first, *(sheet for sheet in others if sheet.likely[0])]
        return tuple(FileText(sheet.text, sha256, sheet.notices(sheets), sheet.name) for sheet in chosen)
    if content.startswith(OLD_EXCEL):
        raise FileError(path, "", "an Excel file of before 2007", "save it as .xlsx or as CSV")
    notices = []
    try:
        text = content.decode("utf-16", "replace") if content.startswith(UTF_16) else content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", "replace")
        notices.append("read as Windows-1252 (Latin-1), as it is not UTF-8")
    if NO_TEXT.search(text):
        raise FileError(path, "", "is no text", "a table: CSV, or an Excel workbook (.xlsx)")
    text = TYPOGRAPHIC_MINUS.sub("-", text)
    if not text.endswith(("\n", "\r")):
        notices.append("the last line does not end; is the file complete?")
    return (FileText(text, sha256, tuple(notices)),)


def read_table(path: Path, fits: Callable[[CsvTable], bool] | None = None) -> CsvTable:
    """Reads a table with a header, its columns named as in the file, its numbers with decimal points.

    Blank lines, comment lines and empty columns at the right are left out.

    Args:
        fits: chooses the sheet of a workbook: the first whose table fits, or else the likeliest.

    Raises `FileError`: nothing in it, another kind of file, a row with more or fewer cells than the header, or commas
    that may mean two things.
    """
    first, *others = texts = _texts(path)
    if not others or fits is None:
        return _table(path, first)
    fitting = [table for text in texts if (table := _if_fits(path, text, fits)) is not None]
    if not fitting:
        return _table(path, first)
    best, *too = fitting
    also = enumerate_words([f"'{table.sheet}'" for table in too], LISTED)
    notice = (f"measurements stand in the sheet {also}, too: put all that count into one sheet",) if too else ()
    return replace(best, notices=(*best.notices, *notice))


def _if_fits(path: Path, text: FileText, fits: Callable[[CsvTable], bool]) -> CsvTable | None:
    """The table of a sheet, if it can be read, and fits."""
    try:
        table = _table(path, text)
        return table if fits(table) else None
    except FileError:
        return None


def _table(path: Path, file: FileText) -> CsvTable:
    """The table of a text. Raises `FileError`."""
    if schema := TOOL_SCHEMA.search(file.text):
        what = f"is a file of the schema {schema[1]}, no table"
        raise FileError(path, "", what, "the data are a CSV: do the arguments stand in another order?")
    if begin := RECORDING.match(file.text):
        what = f"begins with '{begin[1]}': a tracker's recording"
        raise FileError(path, "", what, "lrm-ident import RECORDING POSES -o DATA makes measurements of it")
    lines = _with_whole_cells(file.text.splitlines())
    kept = [(number, line) for number, line in enumerate(lines, start=1) if _tells(line)]
    if _by_spaces([line for _, line in kept]):
        lines = ["\t".join(line.split()) for line in lines]
        kept = [(number, lines[number - 1]) for number, _ in kept]
    kept, titles = _without_titles(kept)
    delimiter = _stated_delimiter(lines) or next((mark for mark in DELIMITERS if kept and mark in kept[0][1]), ",")
    if kept and all(is_number(cell.replace(",", ".")) for cell in kept[0][1].split(delimiter)):
        kept.insert(0, _header_in_comment(path, lines, *kept[0], delimiter))
    numbered = [(number, cells) for number, line in kept if any(cells := _cells(line, delimiter))]
    if not numbered:
        raise FileError(path, "", "is empty", "a header that names the columns (pose, q1_deg, …), and a row per pose")
    header, *rows = _cut_to_header(path, numbered, delimiter)
    first, *lines_of = (number for number, _ in numbered)
    columns = tuple(Column(name, name) for name in header)
    notices = (*titles, *file.notices)
    table = CsvTable(path, columns, tuple(rows), tuple(lines_of), first, file.sha256, notices, file.sheet)
    return _with_points(_without_repeated_header(table))


def _with_whole_cells(lines: Sequence[str]) -> list[str]:
    """The lines, each that ends within a quoted cell joined with the next ones, in whose places are empty lines."""
    whole = [*lines]
    for start in range(len(whole)):
        for end in range(start + 2, min(start + MOST_LINES_OF_A_ROW, len(whole)) + 1):
            if not _open(whole[start]):
                break
            if not _open(joined := " ".join(lines[start:end])):
                whole[start:end] = [joined, *[""] * (end - start - 1)]
    return whole


def _open(line: str) -> bool:
    """Whether a line ends within a quoted cell."""
    if line.count('"') % 2 == 0:
        return False
    for delimiter in DELIMITERS:
        try:
            next(csv.reader([line], delimiter=delimiter, strict=True))
        except csv.Error:
            return True
    return False


def _without_repeated_header(table: CsvTable) -> CsvTable:
    """The table without rows that repeat the header, as in files that were put together, and a notice of them."""
    again = [str(line) for row, line in zip(table.rows, table.lines, strict=True) if row == table.header]
    if not again:
        return table
    notice = f"the header stands again in line {enumerate_words(again, LISTED)}: not used"
    return replace(table.without(table.header), notices=(*table.notices, notice))


def _without_titles(kept: Sequence[tuple[int, str]]) -> tuple[list[tuple[int, str]], tuple[str, ...]]:
    """The lines from the header on, and a notice of those above: a title that a person wrote over the table.

    The header has at least half of the cells of the widest row, and as many as the rows if a line has; it is words
    alone. A line of numbers above it is no title, nor is one under words that name its cells: both are a table.
    """
    last = kept[-1][1] if kept else ""
    delimiter = next((mark for mark in DELIMITERS if mark in last), ",")
    split = [_cells(line, delimiter) for _, line in kept]
    cells = [[cell for cell in row if cell] for row in split]
    widest = max(map(len, cells), default=0)
    wide = [row for row, row_cells in enumerate(cells) if 2 * len(row_cells) >= widest]
    widths = [len(split[row]) for row in wide if any(map(_is_decimal, cells[row]))]
    same = (row for row in wide if widths and len(split[row]) == max(widths, key=widths.count))
    header = next(same, next(iter(wide), 0))
    above = cells[:header]
    numbers = any(len(row_cells) > 1 and all(map(_is_decimal, row_cells)) for row_cells in above)
    if not header or numbers or any(map(_is_decimal, cells[header])) or any(map(_is_table, above, above[1:])):
        return [*kept], ()
    lines = "1 line" if header == 1 else f"{header} lines"
    return [*kept[header:]], (f"{lines} above the header not used: {' '.join(cells[0])}",)


def _is_table(names: Sequence[str], row: Sequence[str]) -> bool:
    """Whether cells name those of the next row, among which are numbers."""
    return len(names) == len(row) > 2 and any(map(_is_decimal, row)) and not any(map(_is_decimal, names))


def _cells(line: str, delimiter: str) -> tuple[str, ...]:
    return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=delimiter)))


def _is_decimal(cell: str) -> bool:
    return is_number(cell.replace(",", "."))


def _cut_to_header(
    path: Path, numbered: Sequence[tuple[int, tuple[str, ...]]], delimiter: str
) -> list[tuple[str, ...]]:
    """The cells of each line, the header first, without columns at its right that are all empty.

    Raises `FileError`: a row with more or fewer cells than the header.
    """
    header = numbered[0][1]
    width = len(header)
    while width and not header[width - 1] and not any(any(cells[width - 1 :]) for _, cells in numbered):
        width -= 1
    for number, cells in numbered:
        if len(cells) < width or any(cells[width:]):
            right = "is the file cut off or a comma missing?"
            if delimiter == "," and len(cells) == 2 * width:
                right = "are these decimal commas? then divide the cells by semicolons or tabs"
            elif len(words := [cell for cell in cells if cell]) > 2 and not any(map(_is_decimal, words)):
                right = "does another table begin here? a file has one"
            raise FileError(path, f"line {number}", f"{len(cells)} cells, the header has {width}", right)
    return [cells[:width] for _, cells in numbered]


def _stated_delimiter(lines: list[str]) -> str | None:
    """Delimiter of Excel's first line `sep=;`."""
    first = lines[0].strip().strip('"') if lines else ""
    return first[4:5] if first.lower().startswith("sep=") and len(first) == 5 else None


def _by_spaces(kept: Sequence[str]) -> bool:
    """Whether spaces divide the cells, as numpy writes them: the last row is several numbers, the first has no mark."""
    cells = kept[-1].split() if kept else []
    return len(cells) > 1 and all(map(is_number, cells)) and not any(mark in kept[0] for mark in DELIMITERS)


def _tells(line: str) -> bool:
    bare = line.strip().strip('"').strip(",;\t ")
    return bool(bare) and not bare.startswith(COMMENT) and not bare.lower().startswith("sep=")


def _header_in_comment(path: Path, lines: list[str], first: int, row: str, delimiter: str) -> tuple[int, str]:
    """The comment line just above the first row, if it names as many columns. Raises `FileError`."""
    above = lines[first - 2].strip() if first > 1 else ""
    names = above.lstrip("#%/ \t")
    if above.startswith(COMMENT) and names.count(delimiter) == row.count(delimiter):
        return first - 1, names
    raise FileError(
        path, f"line {first}", "numbers, but no header", "name the columns in the first line: pose, q1_deg, …"
    )


def _with_points(table: CsvTable) -> CsvTable:
    """The table with decimal points for decimal commas. Raises `FileError` if its commas may divide thousands.

    Columns that are mostly empty or words do not tell what commas mean: a note may say "3,4".
    """
    count = [sum(NUMBER.fullmatch(cell) is not None for cell in column) for column in zip(*table.rows, strict=True)]
    numeric_columns = {j for j, filled in enumerate(count) if 2 * filled > len(table.rows)}
    placed = [
        (n, cell)
        for row, n in zip(table.rows, table.lines, strict=True)
        for j, cell in enumerate(row)
        if j in numeric_columns
    ]
    numbers = [(line, cell) for line, cell in placed if NUMBER.fullmatch(cell)]
    cells = [(line, cell) for line, cell in numbers if "," in cell]
    both = next(((line, cell) for line, cell in cells if COMMA_AND_POINT.fullmatch(cell)), None)
    if both:
        what, right = f"'{both[1]}' has a comma and a point", "write numbers without commas for thousands"
        raise FileError(table.path, f"line {both[0]}", what, right)
    numeric = [(line, cell) for line, cell in cells if DECIMAL_COMMA.fullmatch(cell)]
    if not numeric:
        return table
    point = next(((line, cell) for line, cell in numbers if "." in cell and is_number(cell)), None)
    if point or all(THOUSANDS.fullmatch(cell) for _, cell in numeric):
        line, cell = numeric[0]
        why = (
            f"line {point[0]} has a decimal point: '{point[1]}'"
            if point
            else "every comma of the file may divide thousands"
        )
        what = f"'{cell}': a decimal comma or thousands? {why}"
        raise FileError(table.path, f"line {line}", what, "write it with a decimal point")
    rows = (
        tuple(cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell) else cell for cell in row) for row in table.rows
    )
    return replace(table, rows=tuple(rows))


def is_number(cell: str) -> bool:
    """Whether Python reads a cell as a number, infinite or NaN ones too; not 1_000, which no table means."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell
