"""Picture of a move: what was told, what was read, and what the models before and after predict of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_ident.data.wording import joint_labels
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.report.plots.style import HELD_OUT, MODEL, NOMINAL, figure_file, finish


def draw_motion(before: MotionStudy, after: MotionStudy, path: Path) -> None:
    """The move that the model before predicts worst among all joints. Raises `FileError`."""
    squares = np.stack([np.nanmean(fit.residual**2, axis=(1, 2)) for fit in before.fits])
    joint, move = np.unravel_index(int(np.argmax(squares)), squares.shape)
    moves, label = before.moves, joint_labels(before.moves.arm)[joint]
    count = moves.counted[move]
    t = np.arange(len(count))[count] * moves.dt
    with figure_file(path, 9, 6) as figure:
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1))
        told, read = (np.degrees(x[move, :, joint])[count] for x in (moves.command, moves.reading))
        top.step(t, told, where="post", color=NOMINAL, linewidth=1, label="command")
        top.plot(t, read, ".", color="black", markersize=4, label="encoder")
        for study, name, colour in ((before, "before", HELD_OUT), (after, "after", MODEL)):
            left = np.degrees(study.fits[joint].residual[move, :, 0])[count]
            error = float(np.sqrt(np.nanmean(left**2)))
            top.plot(t, read - left, color=colour, linewidth=1.2, label=f"predicted {name}")
            bottom.plot(t, left, color=colour, linewidth=1.2, label=f"{name}: {error:.2f} deg RMS")
        finish(top, "", "angle, deg", f"{label}: the move that was predicted worst before")
        finish(bottom, "time in the move, s", "reading − prediction, deg")
