"""Terms that the commands and the documentation use, in plain words: those of `glossary.md` beside this file.

`docs/glossary.md` is a copy of it; `lrm-ident explain WORD`, the page and the report show its entries.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from lrm_math.errors import LrmError

SOURCE = Path(__file__).with_suffix(".md")
ENTRY = re.compile(r"^\*\*(?P<name>.+?)\*\*(?: \((?P<others>.+)\))?\n: (?P<meaning>.+)$", re.MULTILINE)


@dataclass(frozen=True)
class Term:
    """A term, what it means, and other words that a reader may look it up by."""

    name: str
    meaning: str
    others: tuple[str, ...] = ()


TERMS = tuple(
    Term(entry["name"], entry["meaning"], tuple(filter(None, (entry["others"] or "").split(", "))))
    for entry in ENTRY.finditer(SOURCE.read_text(encoding="utf-8"))
)
"""In the order of the alphabet."""
ON_PAGE = (
    "as deployed", "black-box model", "candidate cause", "empirical term", "held-out", "held out", "identified cause",
    "indistinguishable cause", "lengths, angles and stiffness fitted", "measurement noise", "Moran's I", "nested",
    "RMS", "smooth curve", "spline", "turn of joint", "usual load",
)  # fmt: skip
"""Words that page and report explain where they first stand."""


def term_named(word: str) -> Term:
    """The entry of a word, whatever its capitals and hyphens. Raises `LrmError`."""
    for term in TERMS:
        if _plain(word) in {_plain(name) for name in (term.name, *term.others)}:
            return term
    near = get_close_matches(word.lower(), [name for term in TERMS for name in (term.name, *term.others)], 1)
    meant = f"did you mean '{near[0]}'? " if near else ""
    raise LrmError(f"unknown word '{word}'; {meant}lrm-ident explain lists the terms, lrm-ident effects the effects")


def terms_json() -> str:
    """JSON with the meaning of each word of `ON_PAGE`."""
    return json.dumps({word: term_named(word).meaning for word in ON_PAGE}, ensure_ascii=False)


def _plain(word: str) -> str:
    return re.sub(r"[\W_]+", "", word).lower()
