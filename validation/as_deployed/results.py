"""File of results, which a long run goes on with, and their tables."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from validation.as_deployed.outcome import NOISE_MM, WORSE, WORSE_BEYOND, Record, over_stated_sd, ratio, stated_off
from validation.runner import ResultsFile
from validation.tables import NOT_KNOWN, Column, Value, beyond, figure, grouped, table

SCHEMA = "as-deployed/1"
CLAIMS = {"finding": "", "possible_cause": "?", "description": "~"}
OFF = 0.1
SURE = 2.0
"""Standard deviations that an error exceeds rarely: two as of a Gaussian."""
IN_MM = ("loop/", "real/")
Cases = Mapping[str, Record]
Found = Sequence[Record]
Columns = Mapping[str, Column[Record]]


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


def report(cases: Cases) -> str:
    """Counts by part, then every case as Markdown."""
    simulated = {key: one for key, one in cases.items() if not key.startswith(IN_MM)}
    others = {key: [one] for key, one in cases.items() if key not in simulated}
    groups = {name: [simulated[key] for key in keys] for name, keys in grouped(simulated, group_of).items()}
    parts = []
    if simulated:
        counts = table("worlds", {**groups, "all": [*simulated.values()]}, COUNTS)
        parts += ["## Counts", counts, "## Cases", table("case", {key: [one] for key, one in simulated.items()}, CASES)]
    return "\n\n".join([*parts, *(["## Loop and real arm, mm", table("case", others, IN_MM_CASES)] if others else [])])


def group_of(key: str) -> str:
    """Part, catalogue and number of poses of a key."""
    part, rest = key.split("/", 1)
    name, poses, _ = rest.rsplit("/", 2)
    catalogue = name.partition("/")[0]
    return part if part == "lean" else f"{part}, {catalogue}, {poses} poses"


def _error(name: str, unit_mm: float = NOISE_MM) -> Value[Record]:
    """An error over a unit, where a record has it."""
    return lambda one: None if name not in one else float(one[name] / unit_mm)


def _over_floor(one: Record) -> float | None:
    return None if "floor_mm" not in one else float(one["after_mm"] / one["floor_mm"])


def _never_off(one: Record) -> float | None:
    return ratio(one, "_recorded")


def _named(found: Found) -> str:
    """Steps of one run, how often folds chose each name, or what went wrong."""
    [one] = found
    if "trouble" in one:
        return str(one["trouble"]).replace("|", "/")
    if "chosen" not in one:
        return steps_words(one)
    counted = Counter(name for names in one["chosen"] for name in names)
    return ", ".join(f"{name} ×{count}" for name, count in counted.most_common())


COUNTS: Columns = {
    "number": lambda found: str(len(found)),
    "failed": lambda found: str(sum("trouble" in one for one in found)),
    f"> {WORSE} ×": beyond(ratio, WORSE),
    f"> {WORSE_BEYOND} ×": beyond(ratio, WORSE_BEYOND),
    f"never off > {WORSE} ×": beyond(_never_off, WORSE),
    "median ratio": figure(ratio),
    "worst": figure(ratio, max),
    "before × noise": figure(_error("before_mm")),
    "after × noise": figure(_error("after_mm")),
    "worst after": figure(_error("after_mm"), max),
    f"stated off by > {OFF:.0%}": beyond(stated_off, OFF),
    f"error > {SURE:g} × its sd": beyond(over_stated_sd, SURE),
}
HIDDEN: Columns = {"hidden": lambda found: str(found[0].get("hidden", ""))}
CASES: Columns = {
    **HIDDEN,
    "before × noise": figure(_error("before_mm")),
    "after × noise": figure(_error("after_mm")),
    "floor × noise": figure(_error("floor_mm")),
    "ratio": figure(ratio),
    "never off × noise": figure(_error("after_recorded_mm")),
    "its ratio": figure(_never_off),
    "shown × noise": figure(_error("shown_after_mm")),
    "stated × noise": figure(_error("stated_after_mm")),
    "error / its sd": figure(over_stated_sd),
    "named": _named,
    "verdict": lambda found: str(found[0].get("verdict", NOT_KNOWN)),
}
IN_MM_CASES: Columns = {
    **HIDDEN,
    "before": figure(_error("before_mm", 1.0)),
    "after": figure(_error("after_mm", 1.0)),
    "floor": figure(_error("floor_mm", 1.0)),
    "after / floor": figure(_over_floor),
    "shown before": figure(_error("shown_before_mm", 1.0)),
    "shown after": figure(_error("shown_after_mm", 1.0)),
    "named": _named,
}
"""Cases whose noise is another: RMS in mm, over the floor where there is one."""
