"""Tables of Markdown: rows as given, or one for each group of results, whose columns are stated."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

Result = TypeVar("Result")


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table of Markdown."""
    return "\n".join(table_row(line) for line in (head, ["---"] * len(head), *rows))


def table_row(cells: Sequence[object]) -> str:
    """A line of such a table."""
    return f"| {' | '.join(map(str, cells))} |"


def share(flags: Iterable[bool]) -> str:
    """Count and percentage."""
    values = list(flags)
    return f"{sum(values)} ({100.0 * sum(values) / len(values):.0f} %)"


def spread(values: Iterable[float | None], digits: int) -> str:
    """Median (worst) of what is known."""
    known = sorted(value for value in values if value is not None)
    return f"{known[len(known) // 2]:.{digits}f} ({known[-1]:.{digits}f})" if known else "–"


def table(
    first: str, groups: Mapping[str, Sequence[Result]], columns: Mapping[str, Callable[[Sequence[Result]], str]]
) -> str:
    """A row for each group in which there is something; `columns`: the cell of a group, by the head of its column."""
    rows = [(name, *(of(found) for of in columns.values())) for name, found in groups.items() if found]
    return markdown_table((first, *columns), rows)
