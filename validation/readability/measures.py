"""Statistics of sentences. Both shares are estimates, by rules that are stated where they are applied."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from lrm_ident.report.glossary import TERMS
from validation.readability.prose import Sentence

LONGEST, COMMON = 35, 3000
PASSIVE = re.compile(
    r"\b(?:is|are|was|were|be|been|being)\s+(?:(?:not|never|also|only|then|all|\w+ly)\s+){0,2}"
    r"(?:\w+ed|\w+wn|\w+[aeiou]de|made|done|held|kept|left|told|said|found|built|bound|put|set|read|sent|lost|met|given|taken"
    r"|written|driven|chosen|hidden|begun|run|bent|cut|split|meant|understood|thought|brought|bought|sought)\b",
    re.IGNORECASE,
)
ENDINGS = ("'s", "s", "es", "ed", "d", "ing", "ly", "er", "r", "est", "n", "en", "ness", "ment", "able")


@dataclass(frozen=True)
class SentenceStatistics:
    """Of one set of texts; `rare_share` is None where no list of common words is installed."""

    sentences: int
    median: float
    p95: float
    longest: int
    passive_share: float
    rare_share: float | None
    too_long: tuple[Sentence, ...]
    rare: tuple[tuple[str, int], ...]


def counts(found: Sequence[Sentence]) -> SentenceStatistics:
    """Words a sentence, share of passive sentences, share of rare words, sentences over 35 words."""
    lengths = [len(each.words) for each in found] or [0]
    words = [word for each in found for word in plain_words(each)]
    known = common_words()
    rare = Counter(word for word in words if known and not is_common(word, known))
    return SentenceStatistics(
        sentences=len(found),
        median=float(np.median(lengths)),
        p95=float(np.quantile(lengths, 0.95)),
        longest=max(lengths),
        passive_share=sum(bool(PASSIVE.search(each.text)) for each in found) / max(1, len(found)),
        rare_share=sum(rare.values()) / max(1, len(words)) if known else None,
        too_long=tuple(long_ones(found)),
        rare=tuple(rare.most_common(40)),
    )


def long_ones(found: Iterable[Sentence]) -> list[Sentence]:
    """Sentences of more than 35 words."""
    return [each for each in found if len(each.words) > LONGEST]


def plain_words(sentence: Sentence) -> list[str]:
    """Its words of small letters alone: no numbers, names, units in capitals, or code."""
    return re.findall(r"(?<![\w/@.*-])[a-z]{2,}(?:'s)?(?![\w/@*]|\.\w)", sentence.text.replace("’", "'"))


def common_words() -> frozenset[str] | None:
    """The 3000 most common English words by `wordfreq`, and those of our glossary; None where it is not installed."""
    if find_spec("wordfreq") is None:
        return None
    from wordfreq import top_n_list

    terms = " ".join(part for term in TERMS for part in (term.name, *term.others)).lower()
    return frozenset(top_n_list("en", COMMON)) | frozenset(re.findall(r"[a-z]+", terms))


def is_common(word: str, known: frozenset[str]) -> bool:
    """Is it, or what it is an inflection of, in the list."""
    stems = {word} | {word.removesuffix(ending) for ending in ENDINGS}
    stems |= {stem + "e" for stem in stems} | {stem + "y" for stem in stems if word.endswith(("ies", "ied", "ily"))}
    stems |= {stem[:-1] for stem in stems if len(stem) > 3 and stem[-1] == stem[-2]}
    stems |= {word[:-3] + "y"} if word.endswith(("ies", "ied")) else set()
    return bool(stems & known)
