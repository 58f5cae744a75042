"""`python -m validation.hidden_effects [--part PART …]`: hide effects, let the tool name them, print truth and names.

Parts: `named`, effects as the tool has them, through `diagnose`; `tune` and `report`, other forms, arms and awkward
data, `unforeseen`, `blind` and `fresh`, causes thought of by others, through `auto`; `memory` and `memory-blind`, what
creeps, warms and slips; `faults` to `faults-blind-report`, what goes wrong in a measurement. Thresholds are set by
`named`, `tune`, `memory` and `faults`; the others were written, or have other sizes, places and seeds, for a report.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from lrm_math.errors import FileError
from validation.hidden_effects.case import NAMED
from validation.hidden_effects.catalogue import PARTS
from validation.hidden_effects.examine import Task, examine
from validation.hidden_effects.outcome import Outcome
from validation.hidden_effects.tables import report
from validation.options import Count, asked
from validation.runner import ResultsFile, refuse, run_cases


def main() -> None:
    """Read the options, run, print; write the tables, one of each part after the other."""
    options = asked(
        __doc__,
        part=(NAMED, f"{', '.join(PARTS)}; several by commas"),
        only=("", "only cases whose name contains one of these, by commas"),
        arm=("", "other arms for faults, by commas"),
        first=(0, "first seed"),
        seeds=(Count(5), "data sets per case"),
        poses=(Count(300), "poses per data set"),
        jobs=(2, "worker processes"),
        out=(None, "write the tables to this Markdown file too"),
        results=(None, "file of outcomes, which a later run goes on with"),
        keep=(None, "keep data, models and diagnoses in this folder"),
    )
    parts, only = options.part.split(","), options.only.split(",")
    if unknown := set(parts) - set(PARTS):
        refuse(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    keys = [key for part in parts for key in PARTS[part] if any(word in key for word in only)]
    seeds = range(options.first, options.first + options.seeds)
    tasks = [(key, seed, arm) for key in keys for arm in options.arm.split(",") for seed in seeds]
    try:
        outcomes = run(tasks, options.poses, options.jobs, options.keep, options.results)
    except FileError as problem:
        refuse(problem)
    found = {part: [one for one in outcomes if one.of.part == part] for part in parts}
    size = f"{options.poses} poses, up to {options.seeds} seeds"
    text = "\n".join(report(some, f"Hidden effects: `{part}`, {size}") for part, some in found.items() if some)
    print(text)
    if options.out:
        options.out.write_text(text, encoding="utf-8")


def run(
    tasks: Sequence[Task], poses: int, jobs: int, keep: Path | None = None, results: Path | None = None
) -> list[Outcome]:
    """Outcomes of all tasks, in their order. Raises `FileError`: results are those of something else."""
    cases = {"/".join(filter(None, (*map(str, task), str(poses)))): task for task in tasks}
    file = ResultsFile(results, Outcome, "hidden-effects/1", failed=lambda one: bool(one.trouble)) if results else None
    return [*run_cases(cases, partial(examine, poses=poses, keep=keep), line, jobs, file).values()]


def line(_key: str, one: Outcome) -> str:
    """Progress in one line."""
    names = " > ".join("=".join(step) for step in one.steps) or "no step"
    ratio = "" if one.ratio is None else f"ratio {one.ratio:.2f} "
    false = f"FALSE {', '.join(one.false_names)} " if one.false_names else ""
    z = " ".join(f"{z:+.1f}" for z in one.z)
    of = f"{one.judgement} {one.case} {one.arm} {one.seed}"
    return f"{of}: {names} {ratio}{one.verdict} {false}{z}{one.trouble}".rstrip()


if __name__ == "__main__":
    main()
