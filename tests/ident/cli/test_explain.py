"""`lrm-ident explain`, and the page of the glossary."""

from __future__ import annotations

import re

import pytest

from lrm_ident.report.glossary import SOURCE, TERMS, term_named
from tests.conftest import ROOT
from tests.support.commands import stderr_of, stdout_of


def test_the_page_is_the_codes() -> None:
    """`make schemas` copies it; every entry of it is read."""
    page = SOURCE.read_text(encoding="utf-8")
    assert (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8") == page
    assert len(TERMS) == page.count("\n: ") > 25


def test_every_word_leads_to_one_term() -> None:
    words = [re.sub(r"[\W_]+", "", word).lower() for term in TERMS for word in (term.name, *term.others)]
    assert len(words) == len(set(words))
    assert [term.name for term in TERMS] == sorted((term.name for term in TERMS), key=str.lower)


@pytest.mark.parametrize("word", ["held-out error", "Held out", "held_out_error", "cross-validation"])
def test_a_word_is_found_however_it_is_written(word: str) -> None:
    assert term_named(word).name == "held-out error"


def test_a_term_is_explained_in_two_sentences_at_most() -> None:
    for term in TERMS:
        assert term.meaning.endswith("."), term.name
        assert all(len(sentence.split()) <= 30 for sentence in re.split(r"(?<=[.:]) ", term.meaning)), term.name


def test_a_term_an_effect_and_all_of_them_are_printed() -> None:
    assert stdout_of("explain", "RMS").startswith("RMS: Root mean square")
    assert "source:" in stdout_of("explain", "backlash@joint2")
    assert stdout_of("explain", "--all").count("\n") >= len(TERMS)
    listed = " ".join(stdout_of("explain").split())
    assert all(term.name in listed for term in TERMS)


def test_an_unknown_word_is_one_line_that_says_where_the_words_are() -> None:
    assert "did you mean 'residual'?" in stderr_of("explain", "residul")
    assert "lrm-ident explain lists the terms" in stderr_of("explain", "qqqqqq")
