"""The one writer of results: text and tables for the terminal and as HTML, plain values for JSON, rows for CSV."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from html import escape
from io import StringIO
from textwrap import fill, wrap
from typing import Any, cast

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

OPEN = 6
"""Lines of a list that are shown without unfolding it."""
SENTENCE = 40
"""Letters of a cell from which a last column holds sentences, which stand below their row on a narrow screen."""
BAR = "█"
WORDS: Mapping[str, tuple[str, str]] = {
    "±": ("±: standard error", '"standard error"'),
    "held out": ("held out: not in the fit", "held-out"),
    "rms": ("RMS: root mean square", "RMS"),
}
"""Words that the line below an output explains where it uses them, and what `explain` calls them."""
EXPLAIN = "more: lrm-ident explain"
COLUMNS, LINES, FOOT = 80, 20, 6
"""A terminal's width; lines of a result; those of them that stand around a table below a conclusion."""
WHOLE_WORDS: Mapping[str, Any] = {"break_long_words": False, "break_on_hyphens": False}
MOST_ROWS = 40  # of a table that is not folded


@dataclass(frozen=True)
class ResultTable:
    """A table that prints itself, or becomes CSV or JSON records.

    Attributes:
        columns: "name" or "name|format", with a format specification of Python; formatted columns are flush right.
        cells: one tuple per row. Text is printed as it is in any column; None is an empty cell.
    """

    columns: Sequence[str]
    cells: Iterable[Sequence[object]]
    title: str = ""

    def text(self) -> Iterator[list[str]]:
        """The cells of each row, formatted."""
        formats = [column.partition("|")[2] for column in self.columns]
        for row in self.cells:
            yield [_cell(value, spec) for value, spec in zip(row, formats, strict=True)]

    @property
    def names(self) -> list[str]:
        """Column names without formats."""
        return [column.partition("|")[0] for column in self.columns]

    def grid(self) -> Grid:
        """Text for the terminal, below the title; where that is narrow, words are wrapped and numbers are not."""
        out = Grid(box=SIMPLE_HEAD, show_edge=False, pad_edge=False)
        out.padding, out.collapse_padding = (0, 1), True
        for name, column in zip(self.names, self.columns, strict=True):
            number = "|" in column
            out.add_column(name, justify="right" if number else "left", no_wrap=number, overflow="fold")
        for row in self.text():
            out.add_row(*row)
        return out

    @property
    def least_width(self) -> int:
        """Columns of the narrowest terminal that shows the table: numbers whole, text wrapped at spaces."""
        width = 1
        for column, *cells in zip(self.columns, self.names, *self.text(), strict=True):
            whole = cells if "|" in column else [word for cell in cells for word in cell.split()]
            width += 1 + max(map(len, whole), default=0)
        return width

    def stacked(self) -> ListSection:
        """Each row as one line that names its cells, for a terminal that is too narrow for the table."""
        rows = (
            (row[0], *(f"{name} {cell}" for name, cell in zip(self.names[1:], row[1:], strict=True)))
            for row in self.text()
        )
        return ListSection(self.title, tuple(", ".join(row) for row in rows))

    def csv(self) -> str:
        """CSV text with a header; names and cells hold no commas."""
        return "".join(",".join(row) + "\n" for row in (self.names, *self.text()))

    def records(self) -> list[dict[str, object]]:
        """One JSON object per row, unrounded."""
        return [dict(zip(self.names, row, strict=True)) for row in self.cells]


@dataclass(frozen=True)
class ListSection:
    """A heading and one indented line per item; a long list is cut where it is printed, never in JSON."""

    title: str
    lines: tuple[str, ...]

    def shown(self, most: int | None) -> Iterator[str]:
        """The first lines, and how many more there are; None: all."""
        yield from (f"  {line}" for line in self.lines[:most])
        if most is not None and len(self.lines) > most:
            yield f"  … and {len(self.lines) - most} more; --all shows them"


@dataclass(frozen=True)
class Facts:
    """Labelled facts below a conclusion, one to a line; a long one goes on below its beginning, not below its label."""

    rows: tuple[tuple[str, str], ...]

    def shown(self, width: int) -> Iterator[str]:
        """Lines of at most so many columns; each fact on one line where the reader wraps (0)."""
        label = max((len(name) for name, _ in self.rows), default=0) + 2
        for name, words in self.rows:
            first, further = f"  {name:{label}}", " " * (label + 2)
            lines = [words] if not width else wrap(words, max(width - len(further), 20), **WHOLE_WORDS)
            yield from (f"{further if row else first}{line}" for row, line in enumerate(lines))


@dataclass(frozen=True)
class CommandLine:
    """A command to copy, on one line however narrow the terminal is."""

    text: str


Block = str | Text | ResultTable | ListSection | Facts | CommandLine


@dataclass(frozen=True)
class Document:
    """The result of a command.

    Attributes:
        blocks: the conclusion, in order: what a terminal shows.
        schema, values: for `--json`; anything that `plain` takes.
        behind: the numbers behind the figure, written beside it as CSV.
        details: what a terminal shows with `--all`; page and report have them always.
        about: what the details are, in a few words.
    """

    blocks: Sequence[Block]
    schema: str
    values: Mapping[str, object]
    behind: ResultTable | None = None
    details: Sequence[Block] = ()
    about: str = ""

    @property
    def whole(self) -> list[Block]:
        """The conclusion and the details; a table of these stands for one with its title in the conclusion."""
        longer = {block.title for block in self.details if isinstance(block, ResultTable)}
        shown = [block for block in self.blocks if not (isinstance(block, ResultTable) and block.title in longer)]
        return [*shown, *self.details]

    def printed(self, in_full: bool) -> list[Block]:
        """Blocks for a terminal: everything, or the conclusion and what `--all` would add to it."""
        if in_full or not self.details:
            return [*self.whole, *_jargon(self.whole)]
        more = f"Add --all to see {self.about}."
        return [*self.blocks, *_jargon(self.blocks), more]

    def text(self, width: int = 100) -> str:
        """The conclusion as plain text of so many columns."""
        return _text_of(self.blocks, width)

    def json(self) -> str:
        """JSON text of schema and values, without NaN."""
        return json.dumps(plain({"schema": self.schema, **self.values}), indent=1, allow_nan=False) + "\n"


def room_below(blocks: Sequence[Block]) -> int:
    """Rows that a table below these blocks may have, for the whole to fit on a screen."""
    lines = _text_of(blocks, COLUMNS).splitlines()
    return LINES - FOOT - sum(max(1, -(-len(line) // COLUMNS)) for line in lines)


def _text_of(blocks: Iterable[Block], width: int) -> str:
    console = Console(width=width, file=StringIO(), color_system=None)
    write(console, blocks)
    return cast(StringIO, console.file).getvalue()


def _jargon(blocks: Sequence[Block]) -> Iterator[str]:
    """What RMS or held out means, once below an output that uses it."""
    text = " ".join(map(_words_of, blocks)).lower().replace("held-out", "held out")
    used = [explained for word, explained in WORDS.items() if word in text]
    while used:
        line = "; ".join([*(said for said, _ in used), f"{EXPLAIN} {used[-1][1]}"])
        if len(line) <= COLUMNS:
            yield line
            return
        used.pop()


def _words_of(block: Block) -> str:
    """All text of a block but the cells of a table."""
    if isinstance(block, ResultTable):
        return " ".join((block.title, *block.names))
    if isinstance(block, ListSection):
        return " ".join((block.title, *block.lines))
    return " ".join(" ".join(row) for row in block.rows) if isinstance(block, Facts) else str(block)


def plain(value: Any) -> Any:
    """Plain JSON values of dataclasses, arrays and containers; objects with `as_json` decide for themselves.

    NaN and infinity become null.
    """
    if hasattr(value, "as_json"):
        return plain(value.as_json())
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def stated(values: Iterable[Any], sentence: Callable[[Any], str]) -> list[dict[str, object]]:
    """Dataclasses as JSON, each with its sentence beside its values."""
    return [{**plain(value), "sentence": sentence(value)} for value in values]


def write(console: Console, blocks: Iterable[Block], most: int | None = None) -> None:
    """Prints blocks: tables fitted to the console, at most so many lines of a list.

    Sentences are wrapped at spaces, unless the console leaves that to the reader (`soft_wrap`): then each is one line.
    """
    for block in blocks:
        if isinstance(block, ResultTable):
            if console.soft_wrap or block.least_width <= console.width:
                if block.title:
                    console.print(heading(block.title))
                console.print(block.grid(), soft_wrap=False)
            else:
                write(console, [block.stacked()])
            continue
        if isinstance(block, CommandLine):
            console.print(block.text, highlight=False, markup=False, soft_wrap=True)
            continue
        if isinstance(block, Facts):
            for line in block.shown(0 if console.soft_wrap else console.width):
                console.print(line, highlight=False, markup=False)
            continue
        texts: list[str | Text] = (
            [block] if isinstance(block, str | Text) else [heading(block.title), *block.shown(most)]
        )
        for text in texts:
            shown = text if console.soft_wrap else _wrapped(text, console.width)
            console.print(shown, highlight=False, markup=False)


def _wrapped(text: str | Text, width: int) -> Text:
    """The lines of a text wrapped at spaces; one that begins with spaces goes on further in.

    Text of several styles has no such lines: the console wraps it.
    """
    if isinstance(text, Text) and text.spans:
        return text
    plain, style = (text.plain, text.style) if isinstance(text, Text) else (text, "")
    return Text("\n".join(_hanging(line, width) for line in plain.split("\n")), style)


def _hanging(line: str, width: int) -> str:
    indent = len(line) - len(line.lstrip(" "))
    further = " " * (indent + 2) if indent else ""
    return fill(line, width, subsequent_indent=further, **WHOLE_WORDS)


def heading(text: str) -> Text:
    """A line in bold."""
    return Text(text, style="bold")


def section(title: str, lines: Iterable[str]) -> list[Block]:
    """A heading with indented lines; nothing if there are none."""
    section_lines = tuple(lines)
    return [ListSection(title, section_lines)] if section_lines else []


def _cell(value: object, spec: str) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else format(value, spec)


def blocks_html(blocks: Iterable[Block]) -> str:
    """HTML of blocks: bold lines as headings, text as paragraphs, tables with a caption, long lists folded."""
    return "\n".join(map(_block, blocks))


def table_html(table: ResultTable) -> str:
    """One table; columns with a format are flush right. A narrow screen stacks rows that end in sentences."""
    right, body = ["|" in column for column in table.columns], list(table.text())
    heads = zip(table.names, right, strict=True)
    head = "".join(_td(name, r, 'th scope="col"' if name else "td") for name, r in heads)
    rows = "".join("<tr>" + "".join(_td(cell, r) for cell, r in zip(row, right, strict=True)) + "</tr>" for row in body)
    stacked = any(len(row[-1]) > SENTENCE for row in body) and not right[-1]
    caption = f"<caption>{escape(table.title)}</caption>" if table.title else ""
    kind = ' class="stacked"' if stacked else ""
    html = f"<table{kind}>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    return f'<div class="wide" tabindex="0">{html}</div>'  # the keyboard scrolls it, too


def _block(block: Block) -> str:
    if isinstance(block, ResultTable):
        rows = len(list(block.cells))
        folded = f"<details><summary>{escape(block.title)}: {rows} rows</summary>{table_html(block)}</details>"
        return folded if rows > MOST_ROWS else table_html(block)
    if isinstance(block, ListSection):
        return _list(block)
    if isinstance(block, CommandLine):
        return f"<p><code>{escape(block.text)}</code></p>"
    if isinstance(block, Facts):
        facts = "".join(f"<dt>{escape(name)}</dt><dd>{escape(words)}</dd>" for name, words in block.rows)
        return f'<dl class="facts">{facts}</dl>'
    tag = "h3" if isinstance(block, Text) and "bold" in str(block.style) else "p"
    return f"<{tag}>{escape(str(block).strip())}</{tag}>"


def _list(section: ListSection) -> str:
    title, lines = escape(section.title.strip()), [f"<li>{escape(line)}</li>" for line in section.lines]
    rest = "".join(lines[OPEN:])
    more = f"<details><summary>{len(lines) - OPEN} more</summary><ul>{rest}</ul></details>" if rest else ""
    return f"<h3>{title}</h3><ul>{''.join(lines[:OPEN])}</ul>{more}"


def _td(cell: str, right: bool, tag: str = "td") -> str:
    """A cell; of a bar of blocks, a drawn one. `tag`: with its attributes."""
    if cell and not cell.strip(BAR):
        return f'<td><span class="lrm-share" style="width: {len(cell) / 2}em"></span></td>'
    side = ' class="right"' if right else ""
    return f"<{tag}{side}>{escape(cell)}</{tag.split()[0]}>"
