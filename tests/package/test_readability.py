"""No sentence of more than 35 words in any page, nor in any help; what counts as a sentence."""

from __future__ import annotations

import re

import pytest

from tests.conftest import ROOT
from validation.readability.help_probe import help_texts
from validation.readability.measures import PASSIVE, is_common, long_ones
from validation.readability.prose import Sentence, sentences
from validation.readability.texts import of_helps, page

PAGES = {
    path.relative_to(ROOT).as_posix(): path
    for path in (
        ROOT / "README.md",
        *sorted((ROOT / "integrations").glob("*/README.md")),
        *sorted((ROOT / "docs").rglob("*.md")),
    )
}


def told(found: list[Sentence]) -> list[str]:
    """Where each of them stands."""
    return [f"{each.source}:{each.line}: {each.text}" for each in found]


@pytest.mark.parametrize("name", PAGES)
def test_no_sentence_of_a_page_is_too_long(name: str) -> None:
    assert told(long_ones(page(PAGES[name], name))) == []


def test_no_sentence_of_a_help_is_too_long() -> None:
    found = of_helps(help_texts())
    assert len(found) > 300
    assert told(long_ones(found)) == []


def test_sentences_are_found_with_their_lines_and_code_is_left_out() -> None:
    text = "# A plain title\n\nThe first one ends here. The `second.one` [ends](a.md) there.\n\n"
    text += "    code is not prose\n\n"
    text += "- An item of a\n  list is one.\n\n```\nneither is this code\n```\n\n| a cell of words | 3 |\n|---|---|\n"
    found = [(each.line, each.text) for each in sentences(text, "x")]
    assert found == [
        (1, "A plain title"),
        (3, "The first one ends here."),
        (3, "The CODE ends there."),
        (7, "An item of a list is one."),
        (14, "a cell of words"),
    ]


def test_a_passive_is_a_form_of_be_and_a_participle() -> None:
    assert PASSIVE.search("The row is not written.")
    assert PASSIVE.search("All faults are reported at once.")
    assert not PASSIVE.search("The tool reports all faults.")


def test_an_inflection_of_a_common_word_is_common() -> None:
    known = frozenset({"move", "try", "stop", "large"})
    words = ("moves", "moving", "tries", "tried", "stopped", "larger", "stopping")
    assert all(is_common(word, known) for word in words)
    assert not is_common("backlash", known)


def test_every_picture_has_words_for_those_who_do_not_see_it() -> None:
    pictures = [
        (path.name, words)
        for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
        for words in re.findall(r"!\[([^\]]*)\]\(", path.read_text(encoding="utf-8"))
    ]
    assert len(pictures) > 15
    assert [(page, words) for page, words in pictures if len(words.split()) < 5] == []
