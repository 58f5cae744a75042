"""Figures of `choose-poses`, `design`, `identify-parameters`: positions, indices, expected errors, singular values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.design.observability import INDICES, UNITS, Units
from lrm_ident.design.parameter_elimination import ParameterElimination
from lrm_ident.design.pose_design import CandidateSet, DesignProblem, ExpectedAccuracy, PoseDesign
from lrm_ident.design.pose_selection import PoseSelection
from lrm_ident.report.design import known_sets
from lrm_ident.report.plain_names import plain_name, symbol
from lrm_ident.report.plots.style import (
    GREEN,
    HELD_OUT,
    MODEL,
    NOMINAL,
    figure_file,
    finish,
    legend_below,
    plain_number,
)
from lrm_math.arrays import Array
from lrm_math.model.equilibrium import solve_equilibrium

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RIVAL = 16  # letters in a line of a rival's name
LOOKS = {"now": (NOMINAL, "s", ".."), "with random poses": (HELD_OUT, "x", "//"), "with these": (MODEL, "o", "")}
"""Colour, marker and hatch of each set of poses."""
NEVER = 1e6  # height of a bar, off the figure, where a rival is never detectable
TABLE_A_1 = (
    *(2.34e6, 1.13e6, 8.07e5, 2.93e5, 2.11e5, 1.95e4, 9.25e3, 1.71e3, 1.39e3, 1.02e3, 8.16e2, 7.28e2, 6.16e2, 4.79e2),
    *(3.37e2, 2.43e2, 1.41e2, 1.09e2, 8.45e1, 7.84e1, 6.74e1, 8.68, 4.59, 4.47, 2.76, 2.54, 1.26, 0.984, 0.731, 0.581),
    *(1.18e-4, 1.06e-4, 1.03e-4, 8.21e-5, 8.07e-5, 6.75e-5, 5.31e-5, 3.94e-5, 3.45e-5, 3.22e-5, 1.35e-5, 9.92e-6),
    8.79e-6,
)
"""Singular values that the thesis prints (Conenna 2024, Table A.1), in its units."""
FLOOR = 1e-6  # where singular values that are zero are drawn
NAMES = {"thesis": "in the thesis's units", "scaled": "scaled by typical sizes"}
TITLES = {"thesis": "mm per rad, mm, rad/Nmm", "scaled": "mm per typical size"}


def draw_choice(selection: PoseSelection, data: Measurements, path: Path) -> None:
    """The chosen poses among all, and their indices over those of random choices. Raises `FileError`."""
    with figure_file(path, 13, 4.4) as figure:
        left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1, 0.8))
        for axes, pair in ((left, (0, 2)), (middle, (0, 1))):
            _draw_places(axes, data.tcp, data.tcp[selection.rows], pair)
        gain = [
            selection.observability.value(name) / max(selection.random_baseline.value(name), 1e-300) for name in INDICES
        ]
        bars = right.bar(INDICES, gain, color=MODEL)
        right.bar_label(bars, fmt="%.2f", padding=3)
        right.axhline(1.0, color="black", linewidth=0.8)
        share = 100 * selection.observability.O1 / selection.o1_upper_bound
        right.set(xlabel="observability index", ylabel="index over that of random poses", ylim=(0, 1.15 * max(gain)))
        right.set_title(f"Gain over random poses\n(O1: {share:.1f} % of its bound)")
        right.grid(axis="y")
        right.set_axisbelow(True)


def draw_design(task: DesignProblem, offer: CandidateSet, designed: PoseDesign, path: Path) -> None:
    """Positions of the poses, the expected error of every parameter, and the detectable sizes of the rivals.

    Raises `FileError` for an unknown format or a place that cannot be written.
    """
    widths = (0.7, 1.3) if designed.after.discrimination is None else (0.7, 1.2, 0.5)
    everywhere, chosen = (solve_equilibrium(task.model, poses).tcp for poses in (offer.poses, designed.poses))
    accuracies = known_sets(designed)
    sets = {name: accuracies[name] for name in LOOKS if name in accuracies}
    with figure_file(path, 14, 4.8) as figure:
        panels = figure.subplots(1, len(widths), width_ratios=widths)
        _draw_places(panels[0], everywhere, chosen, (0, 2))
        _draw_errors(panels[1], list(map(symbol, designed.keys)), sets)
        panels[1].set_title(f"Expected error of every parameter (noise {task.noise * 1e3:g} mm per axis)")
        if designed.after.discrimination is not None:
            _draw_rivals(panels[2], [rival.name for rival in designed.after.rivals], sets)


def _draw_errors(axes: Axes, names: Sequence[str], sets: Mapping[str, ExpectedAccuracy]) -> None:
    place = np.arange(len(names))
    for name, accuracy in sets.items():
        colour, marker, _ = LOOKS[name]
        label = f"{name}: TCP to {accuracy.tcp:.3g} mm"
        axes.plot(place, accuracy.standard_errors, marker, color=colour, label=label, markersize=6)
    _log(axes)
    axes.set_xticks(place, names, rotation=90, fontsize=8)
    axes.set_ylabel("standard error, as motion of the tip, mm")
    legend_below(axes, len(sets))


def _draw_rivals(axes: Axes, names: Sequence[str], sets: Mapping[str, ExpectedAccuracy]) -> None:
    """The least detectable size of every rival; no bar where it never is."""
    width = 0.8 / len(sets)
    for k, (name, accuracy) in enumerate(sets.items()):
        colour, _, hatch = LOOKS[name]
        place = np.arange(len(names)) + (k - 0.5 * (len(sets) - 1)) * width
        for x, rival in zip(place, accuracy.rivals, strict=True):
            height = NEVER if rival.detectable_size is None else rival.detectable_size
            bar = axes.bar(x, height, width, color=colour, hatch=hatch, edgecolor="white")
            if rival.detectable_size is not None:
                axes.bar_label(bar, [f"{rival.detectable_size:.2g}"], fontsize=7)
            else:
                axes.text(x, 0.5, "never", rotation=90, fontsize=8, transform=axes.get_xaxis_transform(), ha="center")
    every = (rival.detectable_size for accuracy in sets.values() for rival in accuracy.rivals)
    sizes = [size for size in every if size is not None]
    _log(axes)
    axes.set_ylim(0.5 * min(sizes, default=1.0), 3.0 * max(sizes, default=1.0))
    axes.set_xticks(np.arange(len(names)), [fill(plain_name(name), RIVAL) for name in names], fontsize=8)
    axes.set(ylabel="smallest size that would show, in typical sizes", title="What these poses\ndistinguish")


def _log(axes: Axes) -> None:
    """A logarithmic axis in plain numbers."""
    from matplotlib.ticker import LogLocator  # here, since matplotlib takes half a second to load

    axes.set_yscale("log")
    axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 3.0, 5.0)))
    axes.yaxis.set_major_formatter(plain_number)
    axes.yaxis.set_minor_formatter(plain_number)
    axes.grid()


def _draw_places(axes: Axes, every: Array, chosen: Array, pair: tuple[int, int]) -> None:
    """TCP positions seen along one axis."""
    i, j = pair
    axes.plot(every[:, i] * 1e3, every[:, j] * 1e3, ".", color=NOMINAL, markersize=3, label=f"{len(every)} candidates")
    label = f"{len(chosen)} chosen"
    axes.plot(chosen[:, i] * 1e3, chosen[:, j] * 1e3, "o", color=GREEN, markersize=5, markeredgecolor="k", label=label)
    axes.set_aspect("equal")
    title = f"Positions of the tip, from {'the side' if j == 2 else 'above'}"
    finish(axes, f"{'xyz'[i]}, mm", f"{'xyz'[j]}, mm", title)


def draw_elimination(elimination: ParameterElimination, path: Path) -> None:
    """Singular values before and after, in the thesis's units and scaled. Raises `FileError`."""
    with figure_file(path, 12, 4.6) as figure:
        for axes, units in zip(figure.subplots(1, 2), UNITS, strict=True):
            _draw_singular_values(axes, elimination, units)


def _draw_singular_values(axes: Axes, elimination: ParameterElimination, units: Units) -> None:
    every, kept = elimination.all_values[units], elimination.kept_values[units]
    axes.plot(np.arange(1, len(every) + 1), np.maximum(every, FLOOR), "o", color=NOMINAL, label=f"all {len(every)}")
    label = f"the {len(kept)} kept"
    axes.plot(np.arange(1, len(kept) + 1), kept, "x", color=MODEL, markersize=8, label=label)
    if units == "thesis":
        number = np.arange(1, len(TABLE_A_1) + 1)
        axes.plot(number, TABLE_A_1, "+", color=HELD_OUT, markersize=8, label="thesis, Table A.1")
    if units == elimination.units:
        label = f"threshold {elimination.threshold:g}"
        axes.axhline(elimination.threshold, color="black", linestyle="--", linewidth=1, label=label)
    axes.set_yscale("log")
    zero = f"; points at {FLOOR:g} are zero" if every.min() < FLOOR else ""
    title = f"Singular values, {NAMES[units]}, {elimination.poses} poses{zero}"
    finish(axes, "number", f"singular value, {TITLES[units]}", title)
