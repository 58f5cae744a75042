"""Pictures of the method: real histograms and cumulative curves beside the thesis's Gaussians (Figures 6.4 to 6.9)."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from lrm_ident.data.error_distribution import Distribution, distribution
from lrm_ident.plots.comparison import HELD_OUT, MODEL, NOMINAL, check_format, save_figure
from lrm_ident.report.thesis import label, shapes_of
from lrm_ident.thesis.thesis_options import Crossed, Method
from lrm_math.arrays import Array

BINS, COLUMNS = 28, 4
LINES = ("-", "--", "-.", ":")
COLOURS = ("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#888888")


def draw_method(method: Method, path: Path) -> None:
    """A histogram with its Gaussian for each option, then all cumulative curves. Raises `FileError`."""
    check_format(path)
    shapes = list(shapes_of(method))
    rows = -(-len(shapes) // COLUMNS)
    figure = plt.figure(figsize=(13, 3.0 * rows + 4.2), layout="constrained")
    grid = figure.add_gridspec(rows + 1, COLUMNS, height_ratios=[*[1.0] * rows, 1.5])
    for place, (name, shape) in enumerate(shapes):
        axes = figure.add_subplot(grid[place // COLUMNS, place % COLUMNS])
        _draw_histogram(axes, shape, label(name), MODEL if place else NOMINAL)
        if not place:
            axes.legend(fontsize=8)
    chosen, total = len(method.identified[0].rows), len(method.data)
    everything = [("nominal", method.nominal), *((label(m.option.name), m.residual) for m in method.identified)]
    rest = [("nominal", method.nominal), *((label(m.option.name), m.residual[m.rest]) for m in method.identified)]
    half = COLUMNS // 2
    _draw_curves(figure.add_subplot(grid[rows, :half]), everything, f"all {total} poses")
    _draw_curves(figure.add_subplot(grid[rows, half:]), rest, f"the {total - chosen} poses not chosen")
    save_figure(figure, path)


def draw_crossed(crossed: Crossed, names: tuple[str, str], path: Path) -> None:
    """On each data set the errors of its own parameters and of the other's (Figures 6.8, 6.9). Raises `FileError`."""
    check_format(path)
    figure, panels = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    for j, axes in enumerate(panels):
        mask = crossed.both[j].rest
        sets = [np.linalg.norm(crossed.residual[i][j][mask], axis=1) * 1e3 for i in range(2)]
        edges = np.linspace(0.0, max(errors.max() for errors in sets), BINS + 1).tolist()
        for i, (errors, colour, hatch) in enumerate(zip(sets, (MODEL, HELD_OUT), ("", "///"), strict=True)):
            axes.hist(
                errors,
                edges,
                histtype="stepfilled",
                alpha=0.45,
                color=colour,
                edgecolor=colour,
                hatch=hatch,
                label=f"identified on {names[i]}: mean {errors.mean():.2f}, max {errors.max():.1f} mm",
            )
        axes.set(xlabel="TCP error, mm", ylabel="poses", title=f"measured on {names[j]}, poses not chosen there")
        axes.set_ylim(0, axes.get_ylim()[1] * 1.25)
        axes.legend(loc="upper right", fontsize=8)
    figure.suptitle(f"{label(crossed.option.name)}: parameters of one load on the other")
    save_figure(figure, path)


def _draw_histogram(axes: Axes, shape: Distribution, title: str, colour: str) -> None:
    distance = shape.distance * 1e3
    low = min(0.0, (shape.mean - 2.6 * shape.sd) * 1e3)
    edges = np.linspace(0.0, distance.max(), BINS + 1).tolist()
    axes.hist(distance, edges, color=colour, alpha=0.6)
    at = np.linspace(low, distance.max() * 1.05, 200)
    scale = len(distance) * (edges[1] - edges[0]) * 1e-3
    axes.plot(at, shape.density(at * 1e-3) * scale, color="black", linestyle="--", linewidth=1.2, label="Gaussian")
    says = "" if shape.is_gaussian else ", not Gaussian"
    axes.set_title(f"{title}: {distance.mean():.2f} mm{says}", fontsize=10)
    axes.set_xlabel("TCP error, mm", fontsize=8)
    axes.tick_params(labelsize=8)


def _draw_curves(axes: Axes, named: list[tuple[str, Array]], title: str) -> None:
    for number, (name, residual) in enumerate(named):
        shape = distribution(residual)
        share = 100 * np.arange(1, len(shape.distance) + 1) / len(shape.distance)
        axes.plot(
            shape.distance * 1e3,
            share,
            color=COLOURS[number % len(COLOURS)],
            linestyle=LINES[number % len(LINES)],
            linewidth=1.8,
            label=f"{name}: mean {shape.mean * 1e3:.2f}",
        )
    axes.set(xlabel="TCP error, mm", ylabel="share of the poses below it, %", ylim=(0, 100), title=title)
    axes.set_xlim(left=0)
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", fontsize=8)
