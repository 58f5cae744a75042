"""Outcomes as Markdown: counts by what is hidden, then every case; the same columns for every part."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from validation.hidden_effects.case import Case
from validation.hidden_effects.outcome import FLOOR_MM, NEAR_NOISE, Judgement, Outcome
from validation.interval_coverage import TWO_SIDED_95
from validation.tables import share, spread, table

Found = Sequence[Outcome]
Columns = Mapping[str, Callable[[Found], str]]
WORDS = (
    f"Independent generator (`validation.synthetic`), noise 0.3 mm per axis (floor {FLOOR_MM:.2f} mm RMS). *Right*: "
    "every hidden cause is named, alone or in its class, or rightly none. *Honest*: not right, and nothing false. "
    "*False*: a cause is identified that is none, or *nothing is missing* is printed at a ratio above "
    f"{NEAR_NOISE:.2f}. *A false name*: a step in whose class there is no truth, whatever is said of it; freed offsets "
    "and compliances are always true. *Named*: steps in their order; in brackets those that are no identified cause. "
    "*Ratio*: RMS error over the noise, held out or at unseen poses (of faults: the residual), median (worst). *z*: "
    "how far the hidden parameters that were fitted are from the truth, in standard errors."
)


def report(outcomes: Found, title: str) -> str:
    """Tables of some outcomes."""
    parts = [f"# {title}", WORDS, table("hidden", _groups(outcomes), TOTALS)]
    parts += ["## Cases", table("case", _by(outcomes, lambda case: case.name), CASES)]
    bad = Counter(one.trouble.replace("|", "/") for one in outcomes if one.trouble)
    failures = "\n".join(f"- {count} × {trouble}" for trouble, count in bad.most_common())
    return "\n\n".join([*parts, *(["## Failures", failures] if bad else [])]) + "\n"


def _by(outcomes: Found, name_of: Callable[[Case], str]) -> dict[str, Found]:
    groups: dict[str, list[Outcome]] = {}
    for one in outcomes:
        groups.setdefault(name_of(one.of), []).append(one)
    return dict(groups)


def _groups(outcomes: Found) -> dict[str, Found]:
    return {**_by(outcomes, lambda case: case.group), "all": outcomes}


def _judged(judgement: Judgement) -> Callable[[Found], str]:
    return lambda found: share(one.judgement is judgement for one in found)


def _counted(word: Callable[[Outcome], str]) -> Callable[[Found], str]:
    def of(found: Found) -> str:
        counts = Counter(word(one).replace("|", "/") for one in found)
        return "; ".join(f"{word} ×{count}" for word, count in counts.most_common())

    return of


def _named(one: Outcome) -> str:
    """First names of the steps' classes."""
    names = zip((step[0] for step in one.steps), one.findings, strict=True)
    return " > ".join(name if finding else f"({name})" for name, finding in names) or "–"


def _held(found: Found) -> str:
    z = np.abs([z for one in found for z in one.z])
    return f"{(z < TWO_SIDED_95).sum()} of {len(z)}" if len(z) else "–"


COUNTS: Columns = {
    **{str(judgement): _judged(judgement) for judgement in Judgement},
    "a false name": lambda found: share(bool(one.false_names) for one in found),
    "ratio": lambda found: spread((one.ratio for one in found), 2),
    "s": lambda found: spread((one.seconds for one in found), 1),
}
TOTALS: Columns = {"data sets": lambda found: str(len(found)), **COUNTS, "95 % intervals that hold the truth": _held}
CASES: Columns = {
    "truth": lambda found: found[0].of.truth_words,
    **COUNTS,
    "named": _counted(_named),
    "verdict": _counted(lambda one: one.trouble or one.verdict),
    "z": lambda found: " ".join(f"{z:+.1f}" for one in found for z in one.z) or "–",
}
