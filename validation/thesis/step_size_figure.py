"""Figure of step sizes, as Conenna 2024, Figures 4.7 and 4.8."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lrm_ident.design.observability import Units
from lrm_ident.report.plots.style import GREEN, HELD_OUT, MODEL, figure_file
from validation.thesis.finite_difference_study import StepSizeStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

THESIS_STEP = 1e-9  # Conenna 2024, section 4.6
STYLES = {"option1": (MODEL, "-"), "option2": (HELD_OUT, "--"), "option3": (GREEN, ":"), "all": (MODEL, "-")}


def draw_steps(studies: Sequence[StepSizeStudy], units: Units, path: Path) -> None:
    """Norm over exact norm, and error, by step; a column for each posture. Raises `FileError`."""
    angles = list(dict.fromkeys(study.angle for study in studies))
    with figure_file(path, 4.4 * len(angles), 6.4) as figure:
        panels = figure.subplots(2, len(angles), sharex=True, sharey="row", squeeze=False)
        for column, angle in enumerate(angles):
            here = [study for study in studies if study.angle == angle]
            _draw_norm(panels[0, column], here)
            _draw_error(panels[1, column], here, THESIS_STEP if units == "thesis" else None)
            panels[0, column].set_title(f"all joints at {np.degrees(angle):.0f} deg", fontsize=10)
        panels[0, 0].set_ylabel("norm by differences / exact norm")
        panels[1, 0].set_ylabel("relative error of the Jacobian")


def _draw_norm(axes: Axes, studies: Sequence[StepSizeStudy]) -> None:
    for study in studies:
        colour, line = STYLES[study.option]
        label = f"{study.option}: exact {study.exact:.3g}"
        axes.plot(study.steps, study.norm / study.exact, color=colour, linestyle=line, linewidth=2, label=label)
    axes.set(ylim=(0.8, 1.3))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9)


def _draw_error(axes: Axes, studies: Sequence[StepSizeStudy], published: float | None) -> None:
    for study in studies:
        colour, line = STYLES[study.option]
        axes.plot(study.steps, study.error, color=colour, linestyle=line, linewidth=2)
    if published is not None:
        axes.axvline(published, color="black", linewidth=1, linestyle="-.")
        axes.text(1.3 * published, 0.2, f"thesis: {published:g}", fontsize=9)
    axes.set(xscale="log", yscale="log", xlabel="step ε")
    axes.grid(alpha=0.3)
