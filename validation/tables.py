"""Tables of Markdown: rows as given, or one for each group of results, whose columns are stated.

A column makes the cell of a group: how often something holds, the median of a value, words and how often each was said.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import median
from typing import TypeVar

NOT_KNOWN = "–"
Result = TypeVar("Result")
Value = Callable[[Result], float | None]
Column = Callable[[Sequence[Result]], str]


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table of Markdown."""
    return "\n".join(table_row(line) for line in (head, ["---"] * len(head), *rows))


def table_row(cells: Sequence[object]) -> str:
    """A line of such a table."""
    return f"| {' | '.join(map(str, cells))} |"


def table(first: str, groups: Mapping[str, Sequence[Result]], columns: Mapping[str, Column[Result]]) -> str:
    """A row for each group in which there is something; columns by their heads."""
    rows = [(name, *(of(found) for of in columns.values())) for name, found in groups.items() if found]
    return markdown_table((first, *columns), rows)


def grouped(results: Iterable[Result], name_of: Callable[[Result], str]) -> dict[str, list[Result]]:
    """Results by the names of their groups, in the order in which these come."""
    groups: dict[str, list[Result]] = {}
    for one in results:
        groups.setdefault(name_of(one), []).append(one)
    return groups


def share(flag: Callable[[Result], bool]) -> Column[Result]:
    """Count and percentage of those for which it holds."""

    def of(found: Sequence[Result]) -> str:
        count = sum(flag(one) for one in found)
        return f"{count} ({100.0 * count / len(found):.0f} %)"

    return of


def figure(value: Value[Result], statistic: Callable[[list[float]], float] = median) -> Column[Result]:
    """A statistic of what is known; of one result its value."""

    def of(found: Sequence[Result]) -> str:
        known = _known(value, found)
        return f"{statistic(known):.2f}" if known else NOT_KNOWN

    return of


def spread(value: Value[Result], digits: int) -> Column[Result]:
    """Median (worst) of what is known."""

    def of(found: Sequence[Result]) -> str:
        known = sorted(_known(value, found))
        return f"{known[len(known) // 2]:.{digits}f} ({known[-1]:.{digits}f})" if known else NOT_KNOWN

    return of


def beyond(value: Value[Result], limit: float) -> Column[Result]:
    """How many of those that are known are farther from zero than a limit."""

    def of(found: Sequence[Result]) -> str:
        known = _known(value, found)
        return f"{sum(abs(one) > limit for one in known)} of {len(known)}" if known else NOT_KNOWN

    return of


def counted(word: Callable[[Result], str]) -> Column[Result]:
    """Words, the most frequent first, with how often each is that of a result."""

    def of(found: Sequence[Result]) -> str:
        counts = Counter(word(one).replace("|", "/") for one in found)
        return "; ".join(f"{word} ×{count}" for word, count in counts.most_common())

    return of


def _known(value: Value[Result], found: Sequence[Result]) -> list[float]:
    return [known for one in found if (known := value(one)) is not None]
