"""`python -m validation.hidden_effects.faults`: what goes wrong in a measurement, through the functions behind `auto`.

The third catalogue: faults of rows, frames, instruments and joints for most of which the tool has no formula, on arms
with the errors of the independent generator. A run is *right* if its first name is a right one, or its verdict an
honest one; a name is false if nothing in its class is right. Half `tune` and half `report` differ in sizes, joints,
moments and seeds.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed

import numpy as np

from validation.hidden_effects.faults.cases import CASES, WRITTEN_LATER
from validation.hidden_effects.faults.outcome import FIRST_SEED, LAB, NEAR_NOISE, FaultOutcome, examine
from validation.hidden_effects.tables import markdown_table

ARMS = (LAB, "so101-like", "ur5-like", "seven-joint")


def table(outcomes: Sequence[FaultOutcome]) -> str:
    """Totals, then every case, as Markdown."""
    judged = [(one.false_names, one.false_findings, one.honest, one.honest_findings) for one in outcomes]
    false, said, honest, honest_said = (sum(map(bool, of)) for of in zip(*judged, strict=True))
    faulty = [one for one in outcomes if "healthy" not in one.case.name]
    near = int(np.sum([one.ratio <= NEAR_NOISE for one in faulty]))
    by_case: dict[str, list[FaultOutcome]] = {}
    for one in outcomes:
        by_case.setdefault(one.case.name, []).append(one)
    rows = [
        (name, _counted(map(_steps, of)), _counted(one.verdict for one in of), _range(of))
        for name, of in by_case.items()
    ]
    head = (
        f"{len(outcomes)} runs: a false name in {false}, as an identified cause in {said}. The first name or verdict "
        f"is right in {honest}, the first identified cause or verdict in {honest_said}. Of {len(faulty)} that are not "
        f"healthy {near} end within {NEAR_NOISE} of the noise. *Left* is the residual over the noise; in brackets are "
        "empirical terms; ! marks what is not right."
    )
    return f"{head}\n\n{markdown_table(('fault', 'named', 'verdict', 'left'), rows)}"


def _counted(words: Iterable[str]) -> str:
    """Words and how often each comes, the most frequent first."""
    return "; ".join(f"{word} ×{count}" for word, count in Counter(words).most_common())


def _range(of: Sequence[FaultOutcome]) -> str:
    ratios = [one.ratio for one in of]
    return f"{min(ratios):.2f} to {max(ratios):.2f}"


def _steps(one: FaultOutcome) -> str:
    """First names of the steps' classes; those that only describe in brackets."""
    named = [step[0] for step in one.steps]
    said = (name if finding else f"({name})" for name, finding in zip(named, one.findings, strict=True))
    return ("" if one.honest else "! ") + (" > ".join(said) or "–")


def main() -> None:
    """Read the options, run, print the table."""
    parser = argparse.ArgumentParser(prog="python -m validation.hidden_effects.faults", description=__doc__)
    parser.add_argument("--half", choices=tuple(FIRST_SEED), default="tune")
    parser.add_argument("--arm", choices=ARMS, action="append", help=f"arms (default: {LAB}); may be repeated")
    parser.add_argument("--seeds", type=int, default=1, help="data sets per case and arm")
    parser.add_argument("--poses", type=int, default=200, help="poses per data set")
    parser.add_argument("--only", default="", help="only cases whose name contains this")
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument("--later", action="store_true", help="the faults that were written after all judgement was set")
    options = parser.parse_args()
    cases = [one for one in (WRITTEN_LATER if options.later else CASES) if options.only in one.name]
    runs = [(c, arm, n) for c in cases for arm in options.arm or (LAB,) for n in range(options.seeds)]
    with ProcessPoolExecutor(options.jobs) as pool:
        futures = {
            pool.submit(examine, c, arm, options.half, n, options.poses): i for i, (c, arm, n) in enumerate(runs)
        }
        done: dict[int, FaultOutcome] = {}
        for future in as_completed(futures):
            one = done[futures[future]] = future.result()
            print(
                f"{one.case.name}, {one.arm}: {_steps(one)} {one.verdict} {one.ratio:.2f}", file=sys.stderr, flush=True
            )
    print(table([done[i] for i in range(len(runs))]))


if __name__ == "__main__":
    main()
