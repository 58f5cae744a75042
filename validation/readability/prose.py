"""Sentences of a Markdown page, with the line where each begins; code, addresses and pictures' paths are left out."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

FENCE = re.compile(r"^\s*(```|~~~)")
ITEM = re.compile(r"^\s*(?:[-*+]|\d+\.|:)\s+")
RULE = re.compile(r"^[\s|:-]+$")
SENTENCE_END = re.compile(r"(?<=[.!?])(?<!e\.g\.)(?<!i\.e\.)(?<!Eq\.)(?<!cf\.)[)\"'*]*\s+(?=[\"'(*`\[]*[A-Z0-9`…-])")
CODE = re.compile(r"``.+?``|`[^`]*`")
LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
HTML = re.compile(r"<[^>]+>")


@dataclass(frozen=True)
class Sentence:
    """A sentence as plain words, and where it stands."""

    text: str
    source: str
    line: int

    @property
    def words(self) -> list[str]:
        """What stands between spaces and has a letter or a digit; code counts as one word, `CODE`."""
        return [word for word in self.text.split() if re.search(r"[^\W_]", word)]


def sentences(text: str, source: str) -> list[Sentence]:
    """Of paragraphs, items of lists, headings and cells of tables, each by itself; three words or more."""
    found = [each for line, block in blocks(text) for each in split(block, source, line)]
    return [each for each in found if len(each.words) >= 3]


def split(block: str, source: str, line: int) -> Iterator[Sentence]:
    """Ends at a full stop, a question or an exclamation mark before a capital; colons and semicolons do not count."""
    plain = HTML.sub(" ", LINK.sub(r"\1", CODE.sub(" CODE ", block))).replace("**", "").replace(" CODE .", " CODE.")
    start = 0
    for end in [*(found.end() for found in SENTENCE_END.finditer(plain)), len(plain)]:
        yield Sentence(" ".join(plain[start:end].split()), source, line + plain[:start].count("\n"))
        start = end


def blocks(text: str) -> Iterator[tuple[int, str]]:
    """Line number (from 1) and text of every paragraph, list item, heading and table cell that is no code."""
    fenced, gap, listed = False, True, False
    block: list[str] = []
    start = 0
    for number, line in enumerate([*text.splitlines(), ""], 1):
        fence = FENCE.match(line)
        code = fenced or bool(fence) or (line.startswith("    ") and gap and not listed)
        begins = bool(ITEM.match(line)) or line.startswith(("#", "|", ">"))
        if block and (code or begins or not line.strip()):
            yield start, "\n".join(block)
            block = []
        if fence:
            fenced = not fenced
        elif line.startswith("|") and not code:
            yield from ((number, cell) for cell in line.strip("|").split("|") if not RULE.match(line))
        elif line.strip() and not code:
            start = start if block else number
            block.append(ITEM.sub("", line).lstrip("#> "))
        gap = not line.strip() or (gap and code)
        listed = bool(ITEM.match(line)) or (listed and (not line.strip() or line.startswith(" ")))
