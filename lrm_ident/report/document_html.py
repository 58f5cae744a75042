"""Documents as HTML: the same blocks that the terminal shows, for pages and reports."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from rich.text import Text

from lrm_ident.report.document import Block, ListSection, ResultTable

OPEN = 6
"""Lines of a list that are shown without unfolding it."""
SENTENCE = 40
"""Letters of a cell from which a last column holds sentences, which stand below their row on a narrow screen."""
BAR = "█"
MOST_ROWS = 40  # of a table that is not folded


def blocks_html(blocks: Iterable[Block]) -> str:
    """HTML of blocks: bold lines as headings, text as paragraphs, tables with a caption, long lists folded."""
    return "\n".join(map(_block, blocks))


def table_html(table: ResultTable) -> str:
    """One table; columns with a format are flush right. A narrow screen stacks rows that end in sentences."""
    right, body = ["|" in column for column in table.columns], list(table.text())
    head = "".join(_head(name, r) for name, r in zip(table.names, right, strict=True))
    rows = "".join(
        "<tr>" + "".join(_cell(cell, r) for cell, r in zip(row, right, strict=True)) + "</tr>" for row in body
    )
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
    tag = "h3" if isinstance(block, Text) and "bold" in str(block.style) else "p"
    return f"<{tag}>{escape(str(block).strip())}</{tag}>"


def _list(section: ListSection) -> str:
    title, lines = escape(section.title.strip()), [f"<li>{escape(line)}</li>" for line in section.lines]
    rest = "".join(lines[OPEN:])
    more = f"<details><summary>{len(lines) - OPEN} more</summary><ul>{rest}</ul></details>" if rest else ""
    return f"<h4>{title}</h4><ul>{''.join(lines[:OPEN])}</ul>{more}"


def _head(name: str, right: bool) -> str:
    """The head of a column; one without a name is no header."""
    return f'<th scope="col"{_side(right)}>{escape(name)}</th>' if name else f"<td{_side(right)}></td>"


def _cell(cell: str, right: bool) -> str:
    """A cell; of a bar of blocks, a drawn one."""
    if cell and not cell.strip(BAR):
        return f'<td><span class="lrm-share" style="width: {len(cell) / 2}em"></span></td>'
    return f"<td{_side(right)}>{escape(cell)}</td>"


def _side(right: bool) -> str:
    return ' class="right"' if right else ""
