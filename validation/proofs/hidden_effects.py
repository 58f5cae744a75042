"""`python -m validation.proofs.hidden_effects`: effects hidden by the independent generator, and what is named.

A data set counts as *right* if a truth is in the first class (or the verdict is the right one), as *alone* if that
class has no other member, as *wrong* if one name alone is stated and it is not the truth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_ident.fitting.executors import executor_for
from validation.hidden_effects.__main__ import run
from validation.hidden_effects.cases import CASES
from validation.hidden_effects.outcome import Outcome
from validation.hidden_effects.tables import KINDS
from validation.options import asked
from validation.proofs.result_file import FOLDER, computed, write

NAME = "hidden-effects.json"
COLUMNS = ("what was hidden", "data sets", "right", "alone", "wrong", "remaining error over noise, median", "worst")


def rows(outcomes: Sequence[Outcome]) -> list[tuple[object, ...]]:
    """A line for each kind of case, and one for all."""
    groups = {name: [one for one in outcomes if one.case in cases] for name, cases in KINDS.items()}
    return [_row(name, found) for name, found in (*groups.items(), ("all", list(outcomes))) if found]


def _row(name: str, found: Sequence[Outcome]) -> tuple[object, ...]:
    ratios = [one.ratio for one in found if one.ratio is not None]
    return (
        name,
        len(found),
        sum(one.hit for one in found),
        sum(one.hit and len(one.first_class) <= 1 for one in found),
        sum(not one.hit and len(one.first_class) == 1 for one in found),
        round(float(np.median(ratios)), 2) if ratios else None,
        round(max(ratios), 2) if ratios else None,
    )


def main() -> None:
    """Writes the result."""
    options = asked(
        __doc__,
        seeds=(1, "data sets of each case"),
        every=(1, "only every so many of the cases"),
        poses=(300, "poses of each data set"),
        jobs=(1, "processes side by side"),
        out=FOLDER / NAME,
    )
    tasks = [(name, seed, "") for name in list(CASES)[:: options.every] for seed in range(options.seeds)]
    with executor_for(None, most=options.jobs) as pool:
        outcomes = run(tasks, options.poses, pool)
    write(options.out, computed(COLUMNS, rows(outcomes)))


if __name__ == "__main__":
    main()
