"""File of results, which a long run goes on with, and their tables."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from validation.as_deployed.outcome import NOISE_MM, WORSE, WORSE_BEYOND, Record, over_stated_sd, ratio, stated_off
from validation.runner import ResultsFile
from validation.tables import markdown_table

SCHEMA = "as-deployed/1"
CLAIMS = {"finding": "", "possible_cause": "?", "description": "~"}
OFF = 0.1
SURE = 2.0
"""Standard deviations that an error exceeds rarely: two as of a Gaussian."""
IN_MM = ("loop/", "real/")
Cases = dict[str, Record]


def results_file(path: Path) -> ResultsFile[Record]:
    """The file of records by the keys of their cases."""
    return ResultsFile(path, dict, SCHEMA, {"noise_rms_mm": NOISE_MM})


def steps_words(record: Record) -> str:
    """Names of the steps; ?: a candidate cause, ~: an empirical term; +: others of its class."""
    words = (
        CLAIMS.get(step["claim"], "!") + step["added"] + "+" * (len(step["names"]) > 1) for step in record["steps"]
    )
    return " > ".join(words) or "no step"


def line_of(key: str, record: Record) -> str:
    """One line of progress."""
    if "trouble" in record or key.startswith(IN_MM):
        return f"{key}: {json.dumps(record, ensure_ascii=False)}"
    floor = f" floor {record['floor_mm'] / NOISE_MM:.2f}" if "floor_mm" in record else ""
    return (
        f"{key}: {record['before_mm'] / NOISE_MM:.2f} -> {record['after_mm'] / NOISE_MM:.2f} x noise "
        f"(ratio {ratio(record):.2f}){floor} {steps_words(record)} {record['verdict']} {record['seconds']} s"
    )


def report(cases: Cases, beside: Cases) -> str:
    """Counts by part, then every case as Markdown; `beside`: records of other code, shown as *then*."""
    simulated = {key: one for key, one in cases.items() if not key.startswith(IN_MM)}
    parts = ["## Counts", _counts(simulated, beside), "## Cases", _table(simulated, beside)] if simulated else []
    others = {key: one for key, one in cases.items() if key not in simulated}
    return "\n\n".join([*parts, *(["## Loop and real arm, mm", _table_in_mm(others, beside)] if others else [])])


def group_of(key: str) -> str:
    """Part, catalogue and number of poses of a key."""
    part, rest = key.split("/", 1)
    name, poses, _ = rest.rsplit("/", 2)
    catalogue = name.partition("/")[0]
    return part if part == "lean" else f"{part}, {catalogue}, {poses} poses"


def _counts(cases: Cases, beside: Cases) -> str:
    groups: dict[str, list[str]] = {}
    for key in cases:
        groups.setdefault(group_of(key), []).append(key)
    groups["all"] = [*cases]
    rows = []
    for group, keys in groups.items():
        rows.append((group, "now", *_count(cases, keys)))
        if both := [key for key in keys if key in beside]:
            if len(both) < len(keys):
                rows.append((group, "now, of those then", *_count(cases, both)))
            rows.append((group, "then", *_count(beside, both)))
    head = ("worlds", "code", "number", "failed", f"> {WORSE} ×", f"> {WORSE_BEYOND} ×", f"never off > {WORSE} ×")
    more = ("median ratio", "worst", "before × noise", "after × noise", "worst after", f"stated off by > {OFF:.0%}")
    return markdown_table((*head, *more, f"error > {SURE:g} × its sd"), rows)


def _count(cases: Cases, keys: list[str]) -> Iterator[str]:
    ran = [cases[key] for key in keys if "trouble" not in cases[key]]
    ratios = np.array([ratio(one) for one in ran], dtype=float)
    never_off = np.array([ratio(one, "_recorded") for one in ran], dtype=float)
    before, after = (np.array([one[f"{when}_mm"] for one in ran]) / NOISE_MM for when in ("before", "after"))
    yield from (str(len(keys)), str(len(keys) - len(ran)))
    yield from (str(int(np.sum(of > by))) for of, by in ((ratios, WORSE), (ratios, WORSE_BEYOND), (never_off, WORSE)))
    if ran:
        figures = (np.median(ratios), ratios.max(), np.median(before), np.median(after), after.max())
        yield from (f"{value:.2f}" for value in figures)
    else:
        yield from "–" * 5
    known = [off for one in ran if (off := stated_off(one)) is not None]
    yield f"{sum(abs(off) > OFF for off in known)} of {len(known)}" if known else "–"
    sure = [over for one in ran if (over := over_stated_sd(one)) is not None]
    yield f"{sum(over > SURE for over in sure)} of {len(sure)}" if sure else "–"


def _table(cases: Cases, beside: Cases) -> str:
    head = (
        "case",
        "hidden",
        "before × noise",
        "after × noise",
        "ratio",
        "never off × noise",
        "its ratio",
        "shown × noise",
        "stated × noise",
        "error / its sd",
        "named",
        "verdict",
    )
    more = ("then before", "then after", "then ratio", "then named") if beside else ()
    rows = []
    for key, record in cases.items():
        then = _then(beside.get(key)) if beside else ()
        if "trouble" in record:
            rows.append((key, record.get("hidden", ""), *("–",) * 9, record["trouble"].replace("|", "/"), *then))
            continue
        floor = f" (floor {record['floor_mm'] / NOISE_MM:.2f})" if "floor_mm" in record else ""
        figures = [f"{record[name] / NOISE_MM:.2f}" for name in ("before_mm", "after_mm", "shown_after_mm")]
        figures[1] += floor
        stated = f"{record['stated_after_mm'] / NOISE_MM:.2f}" if "stated_after_mm" in record else "–"
        never_off = f"{record['after_recorded_mm'] / NOISE_MM:.2f}", f"{ratio(record, '_recorded'):.2f}"
        own = (
            *figures[:2],
            f"{ratio(record):.2f}",
            *never_off,
            figures[2],
            stated,
            "–" if (over := over_stated_sd(record)) is None else f"{over:.2f}",
            steps_words(record),
            record["verdict"],
        )
        rows.append((key, record["hidden"], *own, *then))
    return markdown_table((*head, *more), rows)


def _table_in_mm(cases: Cases, beside: Cases) -> str:
    """Cases whose noise is another: RMS in mm, over the floor where there is one."""
    head = ("case", "hidden", "before", "after", "floor", "after / floor", "shown before", "shown after", "named")
    names = ("before_mm", "after_mm", "floor_mm", "over", "shown_before_mm", "shown_after_mm")
    rows = []
    for key, one in cases.items():
        over = {"over": one["after_mm"] / one["floor_mm"]} if "floor_mm" in one else {}
        figures = [_figure(one | over, name) for name in names]
        for column, name in enumerate(names[:2]):
            if name in (then := beside.get(key, {})):
                figures[column] += f" (then {_figure(then, name)})"
        rows.append((key, one.get("hidden", ""), *figures, one.get("trouble") or _named(one)))
    return markdown_table(head, rows)


def _figure(record: Record, name: str) -> str:
    return f"{record[name]:.2f}" if name in record else "–"


def _named(record: Record) -> str:
    """Steps of one run, or how often folds chose each name."""
    if "chosen" not in record:
        return steps_words(record)
    counted = Counter(name for names in record["chosen"] for name in names)
    return ", ".join(f"{name} ×{count}" for name, count in counted.most_common())


def _then(record: Record | None) -> tuple[str, ...]:
    if record is None or "trouble" in record:
        return ("–",) * 4
    figures = (record["before_mm"] / NOISE_MM, record["after_mm"] / NOISE_MM, ratio(record))
    return (*(f"{value:.2f}" for value in figures), steps_words(record))
