"""Outcomes as Markdown: counts by what is hidden, then every case; the same columns for every part."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from validation.hidden_effects.outcome import FLOOR_MM, NEAR_NOISE, Judgement, Outcome
from validation.interval_coverage import TWO_SIDED_95
from validation.tables import NOT_KNOWN, Column, counted, grouped, share, spread, table

Found = Sequence[Outcome]
Columns = Mapping[str, Column[Outcome]]
WORDS = (
    f"Independent generator (`validation.synthetic`), noise 0.3 mm per axis (floor {FLOOR_MM:.2f} mm RMS). *Right*: "
    "every hidden cause is named, alone or in its class, or rightly none (the part `named` ends after its first name). "
    "*Honest*: not right, and nothing false. "
    "*False*: a cause is identified that is none, or *nothing is missing* is printed at a ratio above "
    f"{NEAR_NOISE:.2f}. *A false name*: a step in whose class there is no truth, whatever is said of it; freed offsets "
    "and compliances are always true. *Named*: steps in their order; in brackets those that are no identified cause. "
    "*Ratio*: RMS error over the noise, held out or at unseen poses (of faults: the residual), median (worst). *z*: "
    "how far the hidden parameters that were fitted are from the truth, in standard errors."
)


def report(outcomes: Found, title: str) -> str:
    """Tables of some outcomes."""
    groups = {**grouped(outcomes, lambda one: one.of.group), "all": outcomes}
    parts = [f"# {title}", WORDS, table("hidden", groups, TOTALS)]
    parts += ["## Cases", table("case", grouped(outcomes, lambda one: one.of.name), CASES)]
    bad = Counter(one.trouble.replace("|", "/") for one in outcomes if one.trouble)
    failures = "\n".join(f"- {count} × {trouble}" for trouble, count in bad.most_common())
    return "\n\n".join([*parts, *(["## Failures", failures] if bad else [])]) + "\n"


def _judged(judgement: Judgement) -> Column[Outcome]:
    return share(lambda one: one.judgement is judgement)


def _named(one: Outcome) -> str:
    """First names of the steps' classes."""
    names = zip((step[0] for step in one.steps), one.findings, strict=True)
    return " > ".join(name if finding else f"({name})" for name, finding in names) or NOT_KNOWN


def _held(found: Found) -> str:
    z = np.abs([z for one in found for z in one.z])
    return f"{(z < TWO_SIDED_95).sum()} of {len(z)}" if len(z) else NOT_KNOWN


COUNTS: Columns = {
    **{str(judgement): _judged(judgement) for judgement in Judgement},
    "a false name": share(lambda one: bool(one.false_names)),
    "ratio": spread(lambda one: one.ratio, 2),
    "s": spread(lambda one: one.seconds, 1),
}
TOTALS: Columns = {"data sets": lambda found: str(len(found)), **COUNTS, "95 % intervals that hold the truth": _held}
CASES: Columns = {
    "truth": lambda found: found[0].of.truth_words,
    **COUNTS,
    "named": counted(_named),
    "verdict": counted(lambda one: one.trouble or one.verdict),
    "z": lambda found: " ".join(f"{z:+.1f}" for one in found for z in one.z) or NOT_KNOWN,
}
