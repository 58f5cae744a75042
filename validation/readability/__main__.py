"""`python -m validation.readability [--tree CHECKOUT]`: how hard README, docs, help and verdicts are to read.

A passive sentence has a form of *to be* with a participle behind it, by a list of endings: about right, not exact.
A rare word is neither among the 3000 most common (package wordfreq), nor an inflection of these, nor in the glossary;
numbers, code and words with capitals do not count.
"""

from __future__ import annotations

from pathlib import Path

from validation.options import asked
from validation.readability.measures import SentenceStatistics, counts
from validation.readability.texts import helps, pages, verdicts
from validation.tables import markdown_table

COLUMNS = "texts", "sentences", "words a sentence: median", "95 %", "longest", "passive", "rare words", "over 35 words"


def row(name: str, found: SentenceStatistics) -> tuple[object, ...]:
    """A row of the table."""
    rare = "–" if found.rare_share is None else f"{100 * found.rare_share:.1f} %"
    lengths = (f"{found.median:.0f}", f"{found.p95:.0f}", found.longest)
    return name, found.sentences, *lengths, f"{100 * found.passive_share:.0f} %", rare, len(found.too_long)


def main() -> None:
    """Prints the table, then the long sentences, then the most frequent rare words if they are wanted."""
    options = asked(
        __doc__,
        tree=(Path(), "a checkout of this project; default: this one"),
        without_verdicts=(False, "leave out what takes a minute"),
        rare=(False, "also print the most frequent rare words"),
    )
    tree = options.tree.resolve()
    docs = pages(tree)
    parts = {
        "README": counts([each for each in docs if each.source == "README.md"]),
        "docs": counts([each for each in docs if each.source != "README.md"]),
        "help": counts(helps(tree)),
        **({} if options.without_verdicts else {"verdicts": counts(verdicts(tree))}),
    }
    print(markdown_table(COLUMNS, [row(name, part) for name, part in parts.items()]))
    for name, part in parts.items():
        print(f"\n{name}, over 35 words:" if part.too_long else "", end="")
        print(*(f"\n  {s.source}:{s.line} ({len(s.words)}) {s.text[:90]}…" for s in part.too_long), sep="")
        if options.rare:
            print(f"{name}, rare:", ", ".join(f"{word} {times}" for word, times in part.rare))


if __name__ == "__main__":
    main()
