"""Documents on a terminal: what is wrapped, and what is not."""

from __future__ import annotations

from io import StringIO

from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from lrm_ident.report.document import Block, Document, ListSection, ResultTable, write

WORDS = st.lists(st.text("abcdefgh,.", min_size=1, max_size=20), min_size=1, max_size=60)
WIDTHS = st.integers(40, 120)


def printed(block: Block, width: int, terminal: bool) -> str:
    """Text on a console of this width."""
    file = StringIO()
    write(Console(file=file, width=width, soft_wrap=not terminal, color_system=None), [block])
    return file.getvalue()


@given(WORDS, WIDTHS)
def test_sentences_and_lists_are_wrapped_at_spaces_on_a_terminal(words: list[str], width: int) -> None:
    for block in (" ".join(words), ListSection("", (" ".join(words),))):
        shown = printed(block, width, terminal=True)
        assert shown.split() == words
        assert all(len(line) <= width for line in shown.splitlines())


@given(WORDS, WIDTHS)
def test_elsewhere_a_sentence_is_one_line(words: list[str], width: int) -> None:
    assert printed(" ".join(words), width, terminal=False) == " ".join(words) + "\n"


@given(st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=8), WORDS)
def test_numbers_of_a_table_are_never_wrapped(values: list[float], words: list[str]) -> None:
    table = ResultTable(("value|+.2f", "why"), [(value, " ".join(words)) for value in values])
    lines = printed(table, 80, terminal=True).splitlines()
    shown = [line.split()[0] for line in lines if line[:12].strip().startswith(("+", "-"))]
    assert shown == [f"{value:+.2f}" for value in values]


@given(st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=5), WORDS, WIDTHS)
def test_a_table_is_never_wider_than_the_terminal_and_its_words_stay_whole(
    values: list[float], words: list[str], width: int
) -> None:
    """It is stacked where it has no room: the same cells, each with the name of its column."""
    table = ResultTable(("the parameter", "value|+.2f", "its error|+.2f"), [(" ".join(words), v, v) for v in values])
    shown = printed(table, width, terminal=True)
    assert all(len(line) <= width for line in shown.splitlines())
    cells = [f"{value:+.2f}" for value in values for _ in range(2)]
    found = [word.rstrip(",") for word in shown.split()]
    assert [one for one in found if one.startswith(("+", "-"))] == cells
    assert {word.rstrip(",") for word in words} <= set(found)


def test_a_longer_table_of_the_details_stands_for_the_short_one() -> None:
    kinds = ((1, "T"), (3, "T"), (1, "U"))
    short, longer, other = (ResultTable(("a|d",), [(k,) for k in range(rows)], title) for rows, title in kinds)
    found = Document(["said", short, other], "lrm/test/1", {}, details=[longer])
    assert found.whole == ["said", other, longer]
    assert found.blocks == ["said", short, other]
