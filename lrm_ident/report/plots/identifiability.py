"""Figure of identifiability, beside the thesis's Table A.1 (Conenna 2024)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lrm_ident.design.observability import UNITS, Units
from lrm_ident.design.parameter_elimination import ParameterElimination
from lrm_ident.report.plots.style import HELD_OUT, MODEL, NOMINAL, figure_file, finish

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TABLE_A_1 = (
    *(2.34e6, 1.13e6, 8.07e5, 2.93e5, 2.11e5, 1.95e4, 9.25e3, 1.71e3, 1.39e3, 1.02e3, 8.16e2, 7.28e2, 6.16e2, 4.79e2),
    *(3.37e2, 2.43e2, 1.41e2, 1.09e2, 8.45e1, 7.84e1, 6.74e1, 8.68, 4.59, 4.47, 2.76, 2.54, 1.26, 0.984, 0.731, 0.581),
    *(1.18e-4, 1.06e-4, 1.03e-4, 8.21e-5, 8.07e-5, 6.75e-5, 5.31e-5, 3.94e-5, 3.45e-5, 3.22e-5, 1.35e-5, 9.92e-6),
    8.79e-6,
)
"""Singular values that the thesis prints (Conenna 2024, Table A.1), in its units."""
FLOOR = 1e-6  # where singular values that are zero are drawn
TITLES = {"thesis": "mm per rad, mm, rad/Nmm", "scaled": "mm per typical size"}


def draw_elimination(found: ParameterElimination, path: Path) -> None:
    """Singular values before and after, in the thesis's units and scaled. Raises `FileError`."""
    with figure_file(path, 12, 4.6) as figure:
        for axes, units in zip(figure.subplots(1, 2), UNITS, strict=True):
            _draw_singular_values(axes, found, units)


def _draw_singular_values(axes: Axes, found: ParameterElimination, units: Units) -> None:
    every, kept = found.all_values[units], found.kept_values[units]
    axes.plot(np.arange(1, len(every) + 1), np.maximum(every, FLOOR), "o", color=NOMINAL, label=f"all {len(every)}")
    label = f"the {len(kept)} kept"
    axes.plot(np.arange(1, len(kept) + 1), kept, "x", color=MODEL, markersize=8, label=label)
    if units == "thesis":
        number = np.arange(1, len(TABLE_A_1) + 1)
        axes.plot(number, TABLE_A_1, "+", color=HELD_OUT, markersize=8, label="thesis, Table A.1")
    if units == found.units:
        label = f"threshold {found.threshold:g}"
        axes.axhline(found.threshold, color="black", linestyle="--", linewidth=1, label=label)
    axes.set_yscale("log")
    title = f"{found.poses} poses" + (f" (at {FLOOR:g}: zero)" if every.min() < FLOOR else "")
    finish(axes, "number", f"singular value, {TITLES[units]}", title)
