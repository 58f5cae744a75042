"""`python -m validation.hidden_effects.unfamiliar`: effects of other forms, other arms, awkward data through `auto`.

Thresholds are set on the half `tune`; the half `report` has other places, arms and seeds and is for the table of
docs/confusion.md, whose section it replaces.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import get_args

from lrm_ident.fitting.executors import as_finished, executor_for
from validation.hidden_effects.auto_outcome import NEAR_FLOOR, AutoOutcome, examine_auto
from validation.hidden_effects.tables import markdown_table, share, spread
from validation.hidden_effects.unfamiliar_cases import UNFAMILIAR
from validation.hidden_effects.unfamiliar_effects import Half

TITLE = "# Other forms than the catalogue's: what `auto` ends with"
GROUPS = ("one effect", "two effects", "three effects", "nothing hidden", "outside the catalogue")


def main() -> None:
    """Read the options, run, print; replace the section of a file."""
    options = _options()
    names = [name for name in UNFAMILIAR if name.endswith("/" + options.half) and options.only in name]
    with executor_for(options.cluster, most=options.jobs) as pool:
        outcomes = run(names, options.seeds, options.poses, pool, options.keep)
    text = section(outcomes, options.half, options.poses, options.seeds)
    print(text)
    if options.out:
        before = options.out.read_text(encoding="utf-8").partition(TITLE)[0].rstrip() if options.out.exists() else ""
        options.out.write_text(f"{before}\n\n{text}".lstrip(), encoding="utf-8")


def run(
    names: Sequence[str], seeds: int, poses: int, executor: Executor, keep: Path | None = None
) -> list[AutoOutcome]:
    """Every case with every seed, side by side; progress goes to stderr."""
    tasks = [(name, seed) for name in names for seed in range(seeds)]
    done: dict[tuple[str, int], AutoOutcome] = {}
    for number, (_, one) in enumerate(
        as_finished(executor, partial(examine_auto, poses=poses, keep=keep), tasks), start=1
    ):
        done[one.case, one.seed] = one
        print(f"{number}/{len(tasks)} {_line(one)}", file=sys.stderr, flush=True)
    return [done[task] for task in tasks]


def section(outcomes: Sequence[AutoOutcome], half: str, poses: int, seeds: int) -> str:
    """The section as Markdown: totals, then case by case."""
    head = (
        f"Second catalogue of the independent generator, half `{half}`, {poses} random poses, {seeds} seeds per case, "
        "0.3 mm of noise per axis. *Named*: every hidden effect is the name of a step, or in its class. *False name*: "
        "a step in whose class there is no truth (freed offsets and compliances are always true), *as a finding* where "
        "it is said to be a cause. *Wrong form*: all "
        f"named, nothing false, and yet more than {NEAR_FLOOR:.2f} times the floor is left. *Ratio*: RMS error at "
        "unseen poses with the noise of a measurement, over that noise, median (worst). *Falsely content*: the verdict "
        "is *nothing is missing* at a ratio above 1.15."
    )
    return "\n\n".join([TITLE, head, _totals(outcomes), "## Cases of other forms", _cases(outcomes)]) + "\n"


def _totals(outcomes: Sequence[AutoOutcome]) -> str:
    groups = {group: [one for one in outcomes if one.of.group == group] for group in GROUPS} | {"all": list(outcomes)}
    columns = (
        "data sets",
        "number",
        "all named",
        "with a false name",
        "as a finding",
        "wrong form",
        f"ratio ≤ {NEAR_FLOOR:.2f}",
    )
    return markdown_table(
        (*columns, "ratio", "falsely content", "failed", "s per auto"),
        [
            (
                group,
                str(len(found)),
                share(one.all_named for one in found),
                share(bool(one.false_names) for one in found),
                share(bool(one.false_findings) for one in found),
                share(one.wrong_form for one in found),
                share(one.near_floor for one in found),
                spread([one.ratio for one in found], 2),
                str(sum(one.falsely_content for one in found)),
                str(sum(bool(one.trouble) for one in found)),
                spread([one.auto_s for one in found], 0),
            )
            for group, found in groups.items()
            if found
        ],
    )


def _cases(outcomes: Sequence[AutoOutcome]) -> str:
    rows = []
    for name in dict.fromkeys(one.case for one in outcomes):
        found = [one for one in outcomes if one.case == name]
        truths = UNFAMILIAR[name].truths
        false = Counter(false for one in found for false in one.false_names)
        rows.append(
            (
                UNFAMILIAR[name].name,
                "no name fits" if truths is None else " + ".join(" or ".join(sorted(right)) for right in truths) or "–",
                f"{sum(one.all_named for one in found)}/{len(found)}",
                _counted(false),
                spread([one.ratio for one in found], 2),
                _counted(Counter(one.trouble or one.verdict for one in found)),
            )
        )
    return markdown_table(("case", "truth", "named", "false names", "ratio", "verdict"), rows)


def _counted(found: Counter[str]) -> str:
    return ", ".join(f"{name.replace('|', '/')} ×{count}" for name, count in found.most_common()) or "–"


def _line(one: AutoOutcome) -> str:
    ratio = "" if one.ratio is None else f"ratio {one.ratio:.2f}"
    names = " > ".join(step[0] + "~" * (len(step) > 1) for step in one.steps) or "no step"
    false = f" FALSE {', '.join(one.false_names)}" if one.false_names else ""
    mark = "named " if one.all_named else "MISSED"
    return f"{mark} {one.case} {one.seed}: {names} {ratio} {one.verdict}{false} {one.trouble}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m validation.hidden_effects.unfamiliar", description=__doc__)
    parser.add_argument("--half", choices=get_args(Half), default="tune")
    parser.add_argument("--only", default="", help="only cases whose name contains this")
    parser.add_argument("--seeds", type=int, default=1, help="data sets per case")
    parser.add_argument("--poses", type=int, default=300, help="poses per data set")
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    parser.add_argument("--cluster", help="Dask scheduler; its workers need this repository on their path")
    parser.add_argument("--out", type=Path, help="write the section into this Markdown file")
    parser.add_argument("--keep", type=Path, help="keep data and models in this folder")
    return parser.parse_args()


if __name__ == "__main__":
    main()
