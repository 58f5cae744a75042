"""Result of `lrm-ident motion design` in words: what the moves tell apart, and what none tells."""

from __future__ import annotations

import shlex
from collections import Counter

import numpy as np

from lrm_ident.data.wording import enumerate_words
from lrm_ident.measuring.excitation.motion_design import MotionDesign, MotionDesignTask
from lrm_ident.report.diagnosis.conclusion import Conclusion
from lrm_ident.report.document import Document, ResultTable
from lrm_ident.report.text.next_steps import NextStep

LISTED = 4


def motion_design_document(task: MotionDesignTask, designed: MotionDesign, output: str) -> Document:
    """Schema `lrm/motion-design/1`."""
    both = designed.both_told()
    told = [f"{a} from {b}" for (a, b), apart in both.items() if apart]
    alike = [f"{a} from {b}" for (a, b), apart in both.items() if not apart]
    joints = enumerate_words([str(k + 1) for k in sorted({move.joint for move in designed.moves})], LISTED)
    if not alike:
        headline = f"These {len(designed.moves)} moves tell {enumerate_words(told, LISTED)}."
    elif told:
        headline = f"These {len(designed.moves)} moves tell {enumerate_words(told, LISTED)}, but not {alike[0]}."
    else:
        headline = f"None of the {designed.offered} safe moves tells {enumerate_words(alike, LISTED)}."
    kinds = [f"{n} {kind}" for kind, n in Counter(move.kind for move in designed.moves).items()]
    facts = [
        ("moves", f"{len(designed.moves)} of joint {joints}: {enumerate_words(kinds, LISTED)}"),
        (
            "time",
            f"{designed.sequence.t[-1]:.0f} s with the ways between; no joint is faster than {_speed(designed)} deg/s",
        ),
    ]
    if alike:
        facts.append(("not told", f"{enumerate_words(alike, LISTED)}, at this speed and this noise"))
    table = ResultTable(
        ("if there is", "and the model has", "random|.2f", "these|.2f", "told apart"),
        [
            (pair.effect, pair.rival, pair.random, pair.designed, "yes" if pair.told else "no")
            for pair in designed.pairs
        ],
        "Expected held-out error with the wrong effect, over the noise: random moves, and these",
    )
    steps = (
        NextStep(
            "Keep the way free, make the moves, and record them",
            (f"lrm-ident motion play {shlex.quote(output)} --robot ROBOT{'' if task.by_tip else ' -o RECORDING.csv'}",),
        ),
    )
    concluded = Conclusion(headline, tuple(facts), (), steps)
    values = {
        "arm": task.model.arm.name,
        "conclusion": concluded,
        "moves": [{"kind": move.kind, "joint": move.joint + 1, "start_rad": move.q[0]} for move in designed.moves],
        "offered": designed.offered,
        "seconds": float(designed.sequence.t[-1]),
        "fastest_rad_per_s": designed.sequence.fastest,
        "pairs": [vars(pair) for pair in designed.pairs],
        "trials": [vars(trial) for trial in designed.trials],
    }
    return Document([*concluded.blocks(), "", table], "lrm/motion-design/1", values)


def _speed(designed: MotionDesign) -> str:
    return f"{np.degrees(designed.sequence.fastest.max()):.0f}"
