"""Tables of text with a cell that is another one."""

from __future__ import annotations


def with_cell(table: str, column: str, value: object, line: int = 2) -> str:
    """A CSV with this in a line's cell of a column, the header being line 0; None: without the column."""
    rows = [row.split(",") for row in table.splitlines()]
    at = rows[0].index(column)
    if value is None:
        rows = [row[:at] + row[at + 1 :] for row in rows]
    else:
        rows[line][at] = str(value)
    return "\n".join(",".join(row) for row in rows) + "\n"
