"""The page of a motion model on a recording: what was missing, the error step by step, and every move before and after.

`lrm-ident motion report` writes it as one file; the workbench opens it as a tab.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from lrm_ident.data.wording import joint_labels
from lrm_ident.measuring.motion.motion_files import MotionSource, open_motion
from lrm_ident.measuring.motion.motion_picture import AXES, READ
from lrm_ident.measuring.motion.motion_report import auto_document, comparison_document, in_unit, parameter_table
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.report.diagnosis.conclusion import Conclusion
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.plots.interactive.assets import SCRIPTS_OF_MOTION
from lrm_ident.report.plots.interactive.candidate_view import rounded
from lrm_ident.workbench.html_report import plain_page

MOST_MOVES, DIGITS = 8, 3
"""Moves that the page shows, those with the largest error before; decimals of their angles."""
MOVES = """<div class="lrm-controls screen-only"><label>what <select id="lrm-what"></select></label>
<label>move <select id="lrm-move"></select></label></div>
<p class="lrm-soft" id="lrm-errors"></p>
<div id="lrm-path" class="lrm-figure medium"></div>
<div id="lrm-left" class="lrm-figure" style="height: 260px"></div>"""


@lru_cache(maxsize=1)
def page_of_files(model: Path, recording: Path) -> str:
    """The page of a motion model's file on a recording, made once, after some seconds of fitting. Raises `LrmError`."""
    _, study = open_motion(model, MotionSource(recording))
    return motion_page(MotionStudy.of(study.moves).fit(), study, str(model))


def motion_page(before: MotionStudy, after: MotionStudy, model: str) -> str:
    """The page's text; `before`: the servos' response alone on the same moves; `model`: its file, for commands."""
    document, values = auto_document(after, after.judged(), model), motion_figures(before, after)
    blocks = [*document.whole, *comparison_document(after).whole, parameter_table(after, after.model.effects)]
    concluded, title = document.values["conclusion"], f"Motion: {after.moves.name}, {after.moves.arm.name}"
    assert isinstance(concluded, Conclusion)
    steps = f'<div id="lrm-steps" class="lrm-figure" style="height: {90 + 30 * len(after.history)}px"></div>'
    shown = "Before and after" if after.model.added else "Moves as predicted"
    figures = {"Error of held-out moves, step by step": steps, shown: MOVES}
    return plain_page(title, concluded.headline, figures, values, document, blocks, SCRIPTS_OF_MOTION)


def motion_figures(before: MotionStudy, after: MotionStudy) -> dict[str, Any]:
    """Steps with their held-out errors, and of every joint (or axis of the tip) the moves, in deg or mm."""
    moves = after.moves
    squares = np.stack([np.nanmean(fit.residual**2, axis=(1, 2)) for fit in before.told_apart]).sum(axis=0)
    shown = sorted(np.argsort(-squares)[:MOST_MOVES].tolist())
    labels = joint_labels(moves.arm) if moves.unit == "deg" else ["tip"]
    rows = [
        _what(before, after, joint, axis, label if moves.unit == "deg" else f"tip along {AXES[axis]}", shown)
        for joint, label in enumerate(labels)
        for axis in range(after.told_apart[joint].residual.shape[2])
    ]
    worst = max(range(len(rows)), key=lambda k: rows[k]["before"])
    return {
        "unit": moves.unit,
        "read": READ[moves.unit],
        "steps": [
            {"name": _step(name), "error": round(error * moves.scale, DIGITS), "words": in_unit(error, moves)}
            for name, error in after.history
        ],
        "noise": round(float(np.sqrt(np.mean(moves.noise**2))) * moves.scale, DIGITS),
        "what": rows,
        "first": worst,
    }


def _what(
    before: MotionStudy, after: MotionStudy, joint: int, axis: int, label: str, shown: list[int]
) -> dict[str, Any]:
    moves, residuals = after.moves, [study.told_apart[joint].residual for study in (before, after)]
    every = (*moves.told_and_read(joint), before.moves.told_and_read(joint)[1], *residuals)
    entries: list[dict[str, Any]] = []
    for move in shown:
        count = moves.counted[move]
        told, read, modelled, *unexplained = (moves.scale * x[move, :, axis][count] for x in every)
        curves = {"told": told, "read": read, "before": modelled - unexplained[0], "after": read - unexplained[1]}
        entries.append(
            {
                "name": f"{move + 1}",
                "dt": round(moves.dt, 6),
                "start": round(float(np.argmax(count)) * moves.dt, 4),
                **{name: rounded(curve, DIGITS) for name, curve in curves.items()},
                "left": [rounded(curve, DIGITS) for curve in unexplained],
            }
        )
    errors = [float(np.sqrt(np.nanmean(residual[:, :, axis] ** 2))) for residual in residuals]
    worst = int(np.argmax([np.nanmean(np.square([v or 0.0 for v in entry["left"][0]])) for entry in entries]))
    return {
        "label": label,
        "added": bool(after.added_at(joint)),
        "words": [in_unit(error, moves) for error in errors],
        "before": errors[0] * moves.scale,
        "moves": entries,
        "first": worst,
    }


def _step(name: str) -> str:
    """A step of the history in plain words: `fit`, `add EFFECT@JOINT` or `drop EFFECT@JOINT`."""
    what, _, effect = name.partition(" ")
    return {"add": plain_name(effect), "drop": f"without {plain_name(effect)}"}[what] if effect else "servo response"
