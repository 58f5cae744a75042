"""Picture of a move: what was told, what was read, and what the models before and after predict of it.

Where nothing was added both predict the same, and one of them is drawn.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_ident.data.wording import joint_labels
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.report.plots.style import HELD_OUT, MODEL, NOMINAL, figure_file, finish

AXES = "xyz"
READ = {"deg": "encoder", "mm": "tracked tip"}
"""What is read, by the unit of its errors."""


def draw_motion(before: MotionStudy, after: MotionStudy, path: Path) -> None:
    """The move that the model before predicts worst, of an encoder or of the tip along the worst axis.

    Raises `FileError`.
    """
    squares = np.stack([np.nanmean(fit.residual**2, axis=1) for fit in before.told_apart])
    joint, move, axis = np.unravel_index(int(np.argmax(squares)), squares.shape)
    moves, unit = after.moves, after.moves.unit
    count, scale = moves.counted[move], moves.scale
    t = np.arange(len(count))[count] * moves.dt
    what, angle = joint_labels(moves.arm)[joint], "angle, deg"
    if unit == "mm":
        what, angle = "tip", f"tip along {AXES[axis]} of the tracker, mm"
    with figure_file(path, 9, 6) as figure:
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.4, 1))
        told, read = (scale * x[move, :, axis][count] for x in moves.told_and_read(int(joint)))
        top.step(t, told, where="post", color=NOMINAL, linewidth=1, label="command")
        top.plot(t, read, ".", color="black", markersize=4, label=READ[unit])
        both = ((before, "before", HELD_OUT), (after, "after", MODEL))
        for study, name, colour in both if after.added_at(int(joint)) else ((after, "(nothing was added)", MODEL),):
            tip_error = scale * study.told_apart[joint].residual[move, :, axis][count]
            error = float(np.sqrt(np.nanmean(tip_error**2)))
            commanded_error = scale * study.moves.told_and_read(int(joint))[1][move, :, axis][count]
            top.plot(t, commanded_error - tip_error, color=colour, linewidth=1.2, label=f"predicted {name}")
            bottom.plot(t, tip_error, color=colour, linewidth=1.2, label=f"{name}: {error:.2f} {unit} RMS")
        finish(top, "", angle, f"{what}: the move that was predicted worst{' before' * bool(after.model.added)}")
        finish(bottom, "time in the move, s", f"reading − prediction, {unit}")
