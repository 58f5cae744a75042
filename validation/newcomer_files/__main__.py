"""`python -m validation.newcomer_files`: random single changes of healthy files, and what the commands make of them."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path

import numpy as np

from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from validation.newcomer_files.boards import board
from validation.newcomer_files.changes import CHANGES, Change
from validation.newcomer_files.healthy import ARMS, NewcomerFiles, healthy_files
from validation.newcomer_files.outcome import (
    OUTCOMES,
    SILENT,
    TRACEBACK,
    VAGUE,
    ChangeOutcome,
    classify,
    fit_files,
    predictions,
    probes,
)
from validation.newcomer_files.readings import READINGS
from validation.newcomer_files.recordings import recording
from validation.options import Count, asked
from validation.runner import run_cases
from validation.tables import markdown_table

FITTED: dict[str, Change] = {**CHANGES, **READINGS}
OTHERS: dict[str, Callable[[np.random.Generator], ChangeOutcome]] = {"recording": recording, "board": board}
KINDS = (*FITTED, *OTHERS)


def main() -> None:
    """Reads the options, runs, prints."""
    options = asked(__doc__, changes=(Count(2000), "how many"), first=(0, "number of the first one"), jobs=1)
    print(outcome_table(run(range(options.first, options.first + options.changes), options.jobs)))


def run(numbers: Iterable[int], jobs: int = 1) -> list[ChangeOutcome]:
    """The outcomes of the changes of these numbers, each the same in every run."""
    return [*run_cases({str(number): number for number in numbers}, examine, line, jobs).values()]


def examine(number: int) -> ChangeOutcome:
    """The outcome of one change."""
    rng, kind = np.random.default_rng([number, 32]), KINDS[number % len(KINDS)]
    if kind in OTHERS:
        return OTHERS[kind](rng)
    files, healthy = healthy_fits()[ARMS[number // len(KINDS) % len(ARMS)]]
    return classify(kind, FITTED[kind](files, rng), healthy)


def line(_key: str, one: ChangeOutcome) -> str:
    """One change; what was said, where the outcome is bad."""
    far = "" if one.difference is None else f" ({one.difference:.3g})"
    said = f": {one.said}" if one.outcome in (SILENT, TRACEBACK, VAGUE) else ""
    return f"{one.outcome}{far}: {one.arm}: {one.what}{said}"


@cache
def healthy_fits() -> dict[str, tuple[NewcomerFiles, Array]]:
    """The files of each arm, and the predictions of the fit to them."""
    out = {}
    with tempfile.TemporaryDirectory() as scratch:
        for name in ARMS:
            files = healthy_files(name, Path(scratch))
            code, said, model = fit_files(files, Path(scratch))
            assert code == 0, said
            out[name] = files, predictions(model, probes(load_arm(name)))
    return out


def outcome_table(found: Sequence[ChangeOutcome]) -> str:
    """Counts by kind and outcome, as Markdown."""
    groups = {kind: [one for one in found if one.kind == kind] for kind in KINDS} | {f"all {len(found)}": found}
    rows = [(name, *(sum(one.outcome == of for one in some) for of in OUTCOMES)) for name, some in groups.items()]
    return markdown_table(("change", *OUTCOMES), rows)


if __name__ == "__main__":
    main()
