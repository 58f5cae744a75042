"""`python -m validation.hidden_effects`: hide effects, let the tool name them, print truth against named."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path

from lrm_ident.fitting.executors import as_finished, executor_for
from validation.hidden_effects.cases import CASES
from validation.hidden_effects.confusion import CaseOutcome, examine
from validation.hidden_effects.tables import report


def main() -> None:
    """Read the options, run, print."""
    options = _options()
    with executor_for(options.cluster, most=options.jobs) as pool:
        outcomes = run(options.cases, options.seeds, options.poses, pool, options.keep)
    text = report(outcomes, options.poses)
    print(text)
    if options.out:
        options.out.write_text(text, encoding="utf-8")


def run(
    names: Sequence[str], seeds: int, poses: int, executor: Executor, keep: Path | None = None
) -> list[CaseOutcome]:
    """Every case with every seed, side by side; progress goes to stderr. In the order of cases and seeds."""
    tasks = [(name, seed) for name in names for seed in range(seeds)]
    done: dict[tuple[str, int], CaseOutcome] = {}
    for number, (_, outcome) in enumerate(
        as_finished(executor, partial(examine, poses=poses, keep=keep), tasks), start=1
    ):
        done[outcome.case, outcome.seed] = outcome
        print(f"{number}/{len(tasks)} {_line(outcome)}", file=sys.stderr, flush=True)
    return [done[task] for task in tasks]


def _line(outcome: CaseOutcome) -> str:
    mark = "hit " if outcome.hit else "MISS"
    ratio = "" if outcome.ratio is None else f" ratio {outcome.ratio:.2f}"
    others = f" (or {', '.join(outcome.first_class[1:])})" if len(outcome.first_class) > 1 else ""
    return f"{mark} {outcome.case} seed {outcome.seed}: {outcome.named}{others}{ratio} {outcome.trouble}".rstrip()


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m validation.hidden_effects", description=__doc__)
    parser.add_argument("--seeds", type=int, default=5, help="data sets per case")
    parser.add_argument("--poses", type=int, default=300, help="poses per data set")
    parser.add_argument("--cases", type=_names, default=list(CASES), help=f"comma-separated: {', '.join(CASES)}")
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    parser.add_argument("--cluster", help="Dask scheduler; its workers need this repository on their path")
    parser.add_argument("--out", type=Path, help="write the tables to this Markdown file too")
    parser.add_argument("--keep", type=Path, help="keep data, models and diagnoses in this folder")
    return parser.parse_args()


def _names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in names if name not in CASES]
    if unknown or not names:
        raise argparse.ArgumentTypeError(f"no such case: {', '.join(unknown)}; there are {', '.join(CASES)}")
    return names


if __name__ == "__main__":
    main()
