"""Sessions that a file names by words, such as days: numbered in the order in which they first stand."""

from __future__ import annotations

from dataclasses import replace

from lrm_ident.data.table_text.csv_file import CsvTable, is_number
from lrm_ident.data.wording import enumerate_words

SESSION = "session"
LISTED = 4
LARGEST_SHARE = 0.5
"""Names per row above which they name the rows, not sessions."""


def with_numbered_sessions(cells: CsvTable) -> CsvTable:
    """The table with numbers in place of the names of sessions, with a notice.

    As it is where they are numbers, or where all rows have one name.
    """
    if SESSION not in cells.header:
        return cells
    at = cells.header.index(SESSION)
    words = [row[at].strip() for row in cells.rows]
    names = {word: str(number) for number, word in enumerate(dict.fromkeys(filter(None, words)), start=1)}
    some_empty = len(names) == 1 and not all(words)
    if any(map(is_number, names)) or not (some_empty or 1 < len(names) <= LARGEST_SHARE * len(words)):
        return cells
    rows = tuple((*row[:at], names.get(word, ""), *row[at + 1 :]) for row, word in zip(cells.rows, words, strict=True))
    listed = enumerate_words([f"{number} = '{word}'" for word, number in names.items()], LISTED)
    return replace(cells, rows=rows, notices=(*cells.notices, f"sessions are numbered: {listed}"))
