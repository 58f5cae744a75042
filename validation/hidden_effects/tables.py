"""The outcomes as Markdown: each case, truth against named, totals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from lrm_math.effects.reference import EffectRef
from validation.hidden_effects.cases import CASES, DOUBLE, NOTHING, OUTSIDE, SINGLE, TRIPLE, HiddenEffectCase
from validation.hidden_effects.confusion import FLOOR_MM, NOTHING_MISSING, UNEXPLAINED, CaseOutcome

KINDS = {
    "one effect": SINGLE,
    "two effects": DOUBLE,
    "three effects": TRIPLE,
    "nothing hidden": {NOTHING.name: NOTHING},
    "outside the catalogue": OUTSIDE,
}
ENDINGS = (NOTHING_MISSING, UNEXPLAINED, "failed")


def report(outcomes: Sequence[CaseOutcome], poses: int) -> str:
    """All tables as Markdown."""
    by_case = {name: [o for o in outcomes if o.case == name] for name in CASES}
    ran = {name: found for name, found in by_case.items() if found}
    seeds = max(len(found) for found in ran.values())
    parts = [
        "# Hidden effects: truth against named",
        f"Independent generator (`validation.synthetic`), {poses} random poses, loads 0 and 66.3 g, noise 0.3 mm per "
        f"axis (floor {FLOOR_MM:.2f} mm RMS), up to {seeds} seeds. *Hit*: a truth is in the first class, or the "
        "verdict is the right one. *Alone*: a hit whose class has no other member. *Wrong name*: a class of one that "
        "is not the truth. *Ratio*: held-out RMS over the floor after the first step, median (worst).",
        "## Cases",
        _cases(ran),
        "## Confusion",
        "Data sets with one effect, none, or one that no name fits; by kind of effect. *At another place*: the right "
        "effect, but no place of its class is right.",
        _confusion(ran),
        "## Totals",
        _totals(ran),
    ]
    return "\n\n".join([*parts, *_troubles(outcomes)]) + "\n"


def truth_text(case: HiddenEffectCase) -> str:
    """The names of the truth."""
    if case.truth is None:
        return UNEXPLAINED
    return " + ".join(case.truth) or NOTHING_MISSING


def _cases(ran: dict[str, list[CaseOutcome]]) -> str:
    head = ("case", "truth", "hits", "alone", "wrong name", "ratio", "s per diagnose", "named first")
    rows = []
    for name, found in ran.items():
        named = Counter(o.named for o in found).most_common()
        rows.append(
            (
                name,
                truth_text(CASES[name]),
                f"{sum(o.hit for o in found)}/{len(found)}",
                f"{sum(o.confident and o.hit for o in found)}",
                f"{sum(o.confidently_wrong for o in found)}",
                spread([o.ratio for o in found], 2),
                spread([o.diagnose_s for o in found], 1),
                ", ".join(f"{what} ×{count}" for what, count in named),
            )
        )
    return markdown_table(head, rows)


def _confusion(ran: dict[str, list[CaseOutcome]]) -> str:
    """Rows: true kind of effect; columns: named kind. A hit counts as its truth, whatever stands first in its class."""
    cells: dict[str, Counter[str]] = {}
    for name, found in ran.items():
        case = CASES[name]
        if len(case.truth or ()) > 1:
            continue
        truth = _kind(truth_text(case))
        cells.setdefault(truth, Counter()).update(_column(o, truth) for o in found)
    columns = [*cells, *sorted({column for row in cells.values() for column in row} - set(cells), key=_last)]
    head = ("truth \\ named", *columns)
    return markdown_table(head, [(truth, *(str(row[c] or "·") for c in columns)) for truth, row in cells.items()])


def _column(outcome: CaseOutcome, truth: str) -> str:
    if outcome.hit:
        return truth
    named = _kind(outcome.named)
    return "at another place" if named == truth else named


def _kind(name: str) -> str:
    return EffectRef.parse(name).id


def _last(column: str) -> tuple[int, str]:
    return (ENDINGS.index(column) + 1 if column in ENDINGS else 0, column)


def _totals(ran: dict[str, list[CaseOutcome]]) -> str:
    head = ("data sets", "number", "hits", "alone", "wrong name", "ratio", "s per diagnose", "failed")
    groups = {kind: [o for name in cases for o in ran.get(name, [])] for kind, cases in KINDS.items()}
    groups["all"] = [o for found in ran.values() for o in found]
    rows = [
        (
            kind,
            str(len(found)),
            share(o.hit for o in found),
            share(o.confident and o.hit for o in found),
            share(o.confidently_wrong for o in found),
            spread([o.ratio for o in found], 2),
            spread([o.diagnose_s for o in found], 1),
            str(sum(bool(o.trouble) for o in found)),
        )
        for kind, found in groups.items()
        if found
    ]
    return markdown_table(head, rows)


def _troubles(outcomes: Iterable[CaseOutcome]) -> list[str]:
    bad = Counter(o.trouble.replace("|", "/") for o in outcomes if o.trouble)
    if not bad:
        return []
    return ["## Failures", "\n".join(f"- {count} × {trouble}" for trouble, count in bad.most_common())]


def share(flags: Iterable[bool]) -> str:
    """Count and percentage."""
    values = list(flags)
    return f"{sum(values)} ({100.0 * sum(values) / len(values):.0f} %)"


def spread(values: Sequence[float | None], digits: int) -> str:
    """Median (worst) of what is known."""
    known = sorted(value for value in values if value is not None)
    return f"{known[len(known) // 2]:.{digits}f} ({known[-1]:.{digits}f})" if known else "–"


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
