"""`python -m validation.newcomer_files`: random single changes of healthy files, and what the commands make of them."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
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

FITTED: dict[str, Change] = {**CHANGES, **READINGS}
OTHERS: dict[str, Callable[[np.random.Generator], ChangeOutcome]] = {"recording": recording, "board": board}
KINDS = (*FITTED, *OTHERS)


def main() -> None:
    """Reads the options, runs, prints."""
    parser = argparse.ArgumentParser(prog="python -m validation.newcomer_files", description=__doc__)
    parser.add_argument("--changes", type=int, default=2000, help="how many")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    options = parser.parse_args()
    found = []
    for outcome in run(range(options.first, options.first + options.changes)):
        found.append(outcome)
        if outcome.outcome in (SILENT, TRACEBACK, VAGUE):
            far = "" if outcome.difference is None else f" ({outcome.difference:.3g})"
            print(f"{outcome.outcome}{far}: {outcome.arm}: {outcome.what}: {outcome.said}", file=sys.stderr, flush=True)
    print(table(found))


def run(numbers: range) -> Iterator[ChangeOutcome]:
    """The outcomes of the changes of these numbers, each the same in every run."""
    before = healthy_fits()
    for number in numbers:
        rng, kind = np.random.default_rng([number, 32]), KINDS[number % len(KINDS)]
        if kind in OTHERS:
            yield OTHERS[kind](rng)
            continue
        files, healthy = before[ARMS[number // len(KINDS) % len(ARMS)]]
        yield classify(kind, FITTED[kind](files, rng), healthy)


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


def table(found: list[ChangeOutcome]) -> str:
    """Counts by kind and outcome, as Markdown."""
    counts = Counter((one.kind, one.outcome) for one in found)
    totals = Counter(one.outcome for one in found)
    lines = [f"| change | {' | '.join(OUTCOMES)} |", "|---" * (len(OUTCOMES) + 1) + "|"]
    for kind in KINDS:
        lines.append(f"| {kind} | {' | '.join(str(counts[kind, outcome]) for outcome in OUTCOMES)} |")
    lines.append(f"| all {len(found)} | {' | '.join(str(totals[outcome]) for outcome in OUTCOMES)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
