"""`python -m validation.proofs.hidden_effects`: effects hidden by the independent generator, and what is named.

Every catalogue but those that thresholds were set by; a line for each and for what was hidden in it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from validation.hidden_effects.__main__ import run
from validation.hidden_effects.case import (
    BLIND,
    FAULTS_BLIND_REPORT,
    FAULTS_REPORT,
    FRESH,
    MEMORY_BLIND,
    NAMED,
    REPORT,
    UNFORESEEN,
)
from validation.hidden_effects.catalogue import PARTS
from validation.hidden_effects.outcome import Judgement, Outcome
from validation.options import asked
from validation.proofs.result_file import FOLDER, computed, write

NAME = "hidden-effects.json"
JUDGEMENTS = (Judgement.RIGHT, Judgement.HONEST, Judgement.FALSE, Judgement.FAILED)
REMAINING = ("remaining error over noise, median", "worst")
COLUMNS = ("catalogue", "hidden", "data sets", *JUDGEMENTS, *REMAINING)
CATALOGUES = {
    "effects as the tool models them (`diagnose`)": (NAMED,),
    "other forms, arms and awkward data": (REPORT,),
    "what goes wrong in a measurement": (FAULTS_REPORT, FAULTS_BLIND_REPORT),
    "creep, warming and slip": (MEMORY_BLIND,),
    "causes thought of by others": (UNFORESEEN, BLIND, FRESH),
}
HIDDEN = {"known effects": True, "nothing": False, "no known effect fits": None}


def rows(outcomes: Sequence[Outcome]) -> list[tuple[object, ...]]:
    """A line for each catalogue and what was hidden, and one for all."""
    groups = {
        (catalogue, words): [one for one in outcomes if one.of.part in parts and one.hidden is hidden]
        for catalogue, parts in CATALOGUES.items()
        for words, hidden in HIDDEN.items()
    }
    return [(*names, *_row(found)) for names, found in (*groups.items(), (("all", ""), list(outcomes))) if found]


def _row(found: Sequence[Outcome]) -> tuple[object, ...]:
    judged = Counter(one.judgement for one in found)
    ratios = [one.ratio for one in found if one.ratio is not None]
    left = (round(float(np.median(ratios)), 2), round(max(ratios), 2)) if ratios else (None, None)
    return len(found), *(judged[one] for one in JUDGEMENTS), *left


def main() -> None:
    """Writes the result."""
    options = asked(
        __doc__,
        seeds=(1, "data sets of each case"),
        every=(1, "only every so many of the cases"),
        poses=(300, "poses of each data set"),
        jobs=(1, "processes side by side"),
        out=FOLDER / NAME,
        results=(None, "file of outcomes, which a later run goes on with"),
    )
    keys = [key for parts in CATALOGUES.values() for part in parts for key in PARTS[part]][:: options.every]
    tasks = [(key, seed, "") for key in keys for seed in range(options.seeds)]
    outcomes = run(tasks, options.poses, options.jobs, results=options.results)
    write(options.out, computed(COLUMNS, rows(outcomes)))


if __name__ == "__main__":
    main()
