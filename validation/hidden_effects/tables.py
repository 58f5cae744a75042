"""Outcomes as Markdown: one table with a row for each group of them, whose columns are stated."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

from lrm_math.effects.reference import EffectRef
from validation.hidden_effects.case import MEMORY_BLIND, Case
from validation.hidden_effects.cases import CASES, DOUBLE, NOTHING, OUTSIDE, SINGLE, TRIPLE
from validation.hidden_effects.outcome import FLOOR_MM, NEAR_FLOOR, NEAR_NOISE, NOTHING_MISSING, UNEXPLAINED, Outcome
from validation.tables import markdown_table, share, spread, table

KINDS = {
    "one effect": SINGLE,
    "two effects": DOUBLE,
    "three effects": TRIPLE,
    "nothing hidden": {NOTHING.name: NOTHING},
    "outside the catalogue": OUTSIDE,
}
ENDINGS = (NOTHING_MISSING, UNEXPLAINED, "failed")
TITLE = "# Other forms than the catalogue's: what `auto` ends with"
Found = Sequence[Outcome]
Columns = Mapping[str, Callable[[Found], str]]


def by_case(outcomes: Found) -> dict[str, Found]:
    """Outcomes by the names of their cases."""
    groups: dict[str, list[Outcome]] = {}
    for one in outcomes:
        groups.setdefault(one.of.name, []).append(one)
    return dict(groups)


def _number(flag: Callable[[Outcome], bool]) -> Callable[[Found], str]:
    return lambda found: str(sum(flag(one) for one in found))


def _share(flag: Callable[[Outcome], bool]) -> Callable[[Found], str]:
    return lambda found: share(flag(one) for one in found)


def _part(flag: Callable[[Outcome], bool]) -> Callable[[Found], str]:
    return lambda found: f"{sum(flag(one) for one in found)}/{len(found)}"


def _spread(value: Callable[[Outcome], float | None], digits: int) -> Callable[[Found], str]:
    return lambda found: spread((value(one) for one in found), digits)


def _counted(words: Callable[[Outcome], Iterable[str]], sign: str = ", ") -> Callable[[Found], str]:
    def of(found: Found) -> str:
        counts = Counter(word.replace("|", "/") for one in found for word in words(one))
        return sign.join(f"{word} ×{count}" for word, count in counts.most_common()) or "–"

    return of


RATIO, SECONDS = _spread(lambda one: one.ratio, 2), _spread(lambda one: one.seconds, 1)
FAILED = _number(lambda one: bool(one.trouble))
NAMED_CASES: Columns = {
    "truth": lambda found: truth_text(found[0].of),
    "hits": _part(lambda one: one.hit),
    "alone": _number(lambda one: one.confident and one.hit),
    "wrong name": _number(lambda one: one.confidently_wrong),
    "ratio": RATIO,
    "s per diagnose": SECONDS,
    "named first": _counted(lambda one: (one.named,)),
}
NAMED_TOTALS: Columns = {
    "number": lambda found: str(len(found)),
    "hits": _share(lambda one: one.hit),
    "alone": _share(lambda one: one.confident and one.hit),
    "wrong name": _share(lambda one: one.confidently_wrong),
    "ratio": RATIO,
    "s per diagnose": SECONDS,
    "failed": FAILED,
}
AUTO_TOTALS: Columns = {
    "number": lambda found: str(len(found)),
    "all named": _share(lambda one: one.all_named),
    "with a false name": _share(lambda one: bool(one.false_names)),
    "as a finding": _share(lambda one: bool(one.false_findings)),
    "wrong form": _share(lambda one: one.wrong_form),
    f"ratio ≤ {NEAR_FLOOR:.2f}": _share(lambda one: one.near_floor),
    "ratio": RATIO,
    "falsely content": _number(lambda one: one.falsely_content),
    "failed": FAILED,
    "s per auto": _spread(lambda one: one.seconds, 0),
}
AUTO_CASES: Columns = {
    "truth": lambda found: _truths(found[0].of),
    "named": _part(lambda one: one.all_named),
    "false names": _counted(lambda one: one.false_names),
    "ratio": RATIO,
    "verdict": _counted(lambda one: (one.trouble or one.verdict,)),
}
FAULTS: Columns = {
    "named": _counted(lambda one: (_marked(one),), "; "),
    "verdict": _counted(lambda one: (one.trouble or one.verdict,), "; "),
    "left": RATIO,
}
FAULTS_TOTALS: Columns = {
    "runs": lambda found: str(len(found)),
    "a false name": _share(lambda one: bool(one.false_names)),
    "as a finding": _share(lambda one: bool(one.false_findings)),
    "first name or verdict right": _share(lambda one: one.honest),
    "first finding or verdict right": _share(lambda one: one.honest_findings),
    f"within {NEAR_NOISE} of the noise": _share(lambda one: one.near_noise),
}
MEMORY: Columns = {
    "worlds": lambda found: str(len(found)),
    "right": _number(lambda one: one.first_right),
    f"error within {NEAR_NOISE} × noise": _number(lambda one: one.near_noise),
    "false names": _number(lambda one: bool(one.false_findings)),
    "z": lambda found: " ".join(f"{z:+.1f}" for one in found for z in one.z) or "–",
}


def report(outcomes: Found, poses: int) -> str:
    """Tables of the catalogue of effects that have names."""
    ran = {name: [one for one in outcomes if one.case == name] for name in CASES}
    groups = {kind: [one for name in cases for one in ran[name]] for kind, cases in KINDS.items()}
    parts = [
        "# Hidden effects: truth against named",
        f"Independent generator (`validation.synthetic`), {poses} random poses, loads 0 and 66.3 g, noise 0.3 mm per "
        f"axis (floor {FLOOR_MM:.2f} mm RMS), up to {max(map(len, ran.values()))} seeds. *Hit*: a truth is in the "
        "first class, or the verdict is the right one. *Alone*: a hit whose class has no other member. *Wrong name*: a "
        "class of one that is not the truth. *Ratio*: held-out RMS over the floor after the first step, median "
        "(worst).",
        "## Cases",
        table("case", ran, NAMED_CASES),
        "## Confusion",
        "Data sets with one effect, none, or one that no name fits; by kind of effect. *At another place*: the right "
        "effect, but no place of its class is right.",
        _confusion(ran),
        "## Totals",
        table("data sets", groups | {"all": list(outcomes)}, NAMED_TOTALS),
    ]
    bad = Counter(one.trouble.replace("|", "/") for one in outcomes if one.trouble)
    failures = "\n".join(f"- {count} × {trouble}" for trouble, count in bad.most_common())
    return "\n\n".join([*parts, *(["## Failures", failures] if bad else [])]) + "\n"


def truth_text(case: Case) -> str:
    """The names of the truth."""
    return UNEXPLAINED if case.truth is None else " + ".join(case.truth) or NOTHING_MISSING


def _truths(case: Case) -> str:
    if case.truths is None:
        return "no name fits"
    return " + ".join(" or ".join(sorted(right)) for right in case.truths) or "–"


def _confusion(ran: Mapping[str, Found]) -> str:
    """Rows: true kind of effect; columns: named kind. A hit counts as its truth, whatever stands first in its class."""
    cells: dict[str, Counter[str]] = {}
    for name, found in ran.items():
        if found and len(CASES[name].truth or ()) <= 1:
            truth = _kind(truth_text(CASES[name]))
            cells.setdefault(truth, Counter()).update(_column(one, truth) for one in found)
    columns = [*cells, *sorted({column for row in cells.values() for column in row} - set(cells), key=_last)]
    rows = [(truth, *(str(row[column] or "·") for column in columns)) for truth, row in cells.items()]
    return markdown_table(("truth \\ named", *columns), rows)


def _column(outcome: Outcome, truth: str) -> str:
    if outcome.hit:
        return truth
    named = _kind(outcome.named)
    return "at another place" if named == truth else named


def _kind(name: str) -> str:
    return EffectRef.parse(name).id


def _last(column: str) -> tuple[int, str]:
    return (ENDINGS.index(column) + 1 if column in ENDINGS else 0, column)


def section(outcomes: Found, part: str, poses: int, seeds: int) -> str:
    """Tables of what `auto` ends with where effects have another form than the tool's, or no name."""
    groups = {group: [one for one in outcomes if one.of.group == group] for group in KINDS} | {"all": outcomes}
    head = (
        f"Second catalogue of the independent generator, half `{part}`, {poses} random poses, {seeds} seeds per case, "
        "0.3 mm of noise per axis. *Named*: every hidden effect is the name of a step, or in its class. *False name*: "
        "a step in whose class there is no truth (freed offsets and compliances are always true), *as a finding* where "
        "it is said to be a cause. *Wrong form*: all "
        f"named, nothing false, and yet more than {NEAR_FLOOR:.2f} times the floor is left. *Ratio*: RMS error at "
        "unseen poses with the noise of a measurement, over that noise, median (worst). *Falsely content*: the verdict "
        "is *nothing is missing* at a ratio above 1.15."
    )
    cases = table("case", by_case(outcomes), AUTO_CASES)
    return "\n\n".join([TITLE, head, table("data sets", groups, AUTO_TOTALS), "## Cases of other forms", cases]) + "\n"


def faults(outcomes: Found) -> str:
    """Tables of what goes wrong in a measurement."""
    groups = {
        "healthy": [one for one in outcomes if "healthy" in one.of.name],
        "faulty": [one for one in outcomes if "healthy" not in one.of.name],
        "all": outcomes,
    }
    words = "*Left* is the residual over the noise; in brackets are empirical terms; ! marks what is not right."
    cases = table("fault", by_case(outcomes), FAULTS)
    return "\n\n".join([table("data sets", groups, FAULTS_TOTALS), words, cases])


def _marked(one: Outcome) -> str:
    """First names of the steps' classes; those that only describe in brackets."""
    names = zip((step[0] for step in one.steps), one.findings, strict=True)
    said = " > ".join(name if finding else f"({name})" for name, finding in names)
    return ("" if one.honest else "! ") + (said or "–")


def memories(outcomes: Found) -> str:
    """Tables of worlds with a memory."""
    groups = {
        "written before": [one for one in outcomes if one.of.truth and one.of.part != MEMORY_BLIND],
        "written after": [one for one in outcomes if one.of.truth and one.of.part == MEMORY_BLIND],
        "nothing hidden": [one for one in outcomes if not one.of.truth],
    }
    cases = table("world", by_case(outcomes), {**MEMORY, "named": FAULTS["named"], "ratio": RATIO})
    return "\n\n".join([table("worlds", groups, MEMORY), cases])
