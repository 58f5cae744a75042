"""Figures of `options`: real histograms and cumulative curves beside the thesis's Gaussians (Figures 6.4 to 6.9)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lrm_ident.report.plots.style import HELD_OUT, MODEL, NOMINAL, figure_file, finish, legend_below
from lrm_math.arrays import Array
from validation.thesis.error_distribution import ErrorDistribution, error_distribution, norms_mm
from validation.thesis.options_report import label, shapes_of
from validation.thesis.thesis_options import CrossLoadResult, OptionStudy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BINS, COLUMNS = 28, 4
LINES = ("-", "--", "-.", ":")
COLOURS = ("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#888888")


def draw_method(method: OptionStudy, path: Path) -> None:
    """A histogram with its Gaussian for each option, then all cumulative curves. Raises `FileError`."""
    shapes = list(shapes_of(method))
    rows = -(-len(shapes) // COLUMNS)
    chosen, total = len(method.identified[0].rows), len(method.data)
    everything = [("nominal", method.nominal), *((label(m.option.name), m.residual) for m in method.identified)]
    equilibrium = [
        ("nominal", method.nominal),
        *((label(m.option.name), m.residual[m.rest]) for m in method.identified),
    ]
    half = COLUMNS // 2
    with figure_file(path, 13, 3.0 * rows + 4.2) as figure:
        grid = figure.add_gridspec(rows + 1, COLUMNS, height_ratios=[*[1.0] * rows, 1.5])
        for place, (name, shape) in enumerate(shapes):
            axes = figure.add_subplot(grid[place // COLUMNS, place % COLUMNS])
            _draw_histogram(axes, shape, label(name), MODEL if place else NOMINAL)
            if not place:
                axes.legend(fontsize=8)
        _draw_curves(figure.add_subplot(grid[rows, :half]), everything, f"all {total} poses")
        _draw_curves(figure.add_subplot(grid[rows, half:]), equilibrium, f"the {total - chosen} poses not chosen")


def draw_crossed(crossed: CrossLoadResult, names: Sequence[str], path: Path) -> None:
    """On each data set the errors of its own parameters and of the other's (Figures 6.8, 6.9). Raises `FileError`."""
    with figure_file(path, 11, 4.2) as figure:
        for j, axes in enumerate(figure.subplots(1, 2)):
            _draw_pair(axes, crossed, names, j)
        figure.suptitle(
            f"{label(crossed.option.name).capitalize()}: parameters of either load on both loads", fontsize=11
        )


def _draw_pair(axes: Axes, crossed: CrossLoadResult, names: Sequence[str], j: int) -> None:
    """Histograms of the errors on data set j, of both sets' parameters."""
    sets = [norms_mm(crossed.residual[i][j][crossed.both[j].rest]) for i in range(2)]
    edges = np.linspace(0.0, max(errors.max() for errors in sets), BINS + 1).tolist()
    for name, errors, colour, hatch in zip(names, sets, (MODEL, HELD_OUT), ("", "///"), strict=True):
        text = f"identified on {name}: mean {errors.mean():.2f}, max {errors.max():.1f} mm"
        kind: Any = {"histtype": "stepfilled", "alpha": 0.45, "color": colour, "edgecolor": colour, "hatch": hatch}
        axes.hist(errors, edges, label=text, **kind)
    title = f"Poses of {names[j]} that the identification did not use"
    finish(axes, "error of the tip, mm", "number of poses", title, legend=False)
    legend_below(axes)


def _draw_histogram(axes: Axes, shape: ErrorDistribution, title: str, colour: str) -> None:
    distance = shape.distance * 1e3
    low = min(0.0, (shape.mean - 2.6 * shape.sd) * 1e3)
    edges = np.linspace(0.0, distance.max(), BINS + 1).tolist()
    axes.hist(distance, edges, color=colour, alpha=0.6)
    at = np.linspace(low, distance.max() * 1.05, 200)
    scale = len(distance) * (edges[1] - edges[0]) * 1e-3
    axes.plot(at, shape.density(at * 1e-3) * scale, color="black", linestyle="--", linewidth=1.2, label="Gaussian")
    note = "" if shape.is_gaussian else ", not Gaussian"
    axes.set_title(f"{title}: mean {distance.mean():.2f} mm{note}", fontsize=10)
    axes.set_xlabel("error of the tip, mm", fontsize=8)
    axes.set_ylabel("number of poses", fontsize=8)
    axes.tick_params(labelsize=8)


def _draw_curves(axes: Axes, named: list[tuple[str, Array]], title: str) -> None:
    for number, (name, residual) in enumerate(named):
        shape = error_distribution(residual)
        share = 100 * np.arange(1, len(shape.distance) + 1) / len(shape.distance)
        colour, line = COLOURS[number % len(COLOURS)], LINES[number % len(LINES)]
        text = f"{name}: mean {shape.mean * 1e3:.2f} mm"
        axes.plot(shape.distance * 1e3, share, color=colour, linestyle=line, linewidth=1.8, label=text)
    axes.set(xlabel="error of the tip, mm", ylabel="poses with a smaller error, %", ylim=(0, 100))
    axes.set_title(f"Error of the tip at {title}", fontsize=11)
    axes.set_xlim(left=0)
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", fontsize=8)
