"""The command `options`: the thesis's method (Conenna 2024, chapter 6) on any data set."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.common import progress, publish, publish_figure, read_measurements, show
from lrm_ident.cli.consoles import out
from lrm_ident.data.measurement_file.conventions import arm_for
from lrm_ident.report.plots.style import HELD_OUT, MODEL, NOMINAL, figure_file
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.model.reading import AS_NAMED, Reading
from validation.thesis.application import command
from validation.thesis.error_distribution import ErrorDistribution, error_distribution, norms_mm
from validation.thesis.options_report import crossed_rows, label, method_blocks, options_document, shapes_of
from validation.thesis.thesis_options import (
    OPTIONS,
    POSES,
    CrossLoadResult,
    OptionStudy,
    cross_apply,
    option_named,
    run_options,
)
from validation.thesis.thesis_results import campaign_named

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
        figure.suptitle(f"{label(crossed.option.name)}: parameters of one load on the other")


def _draw_pair(axes: Axes, crossed: CrossLoadResult, names: Sequence[str], j: int) -> None:
    """Histograms of the errors on data set j, of both sets' parameters."""
    sets = [norms_mm(crossed.residual[i][j][crossed.both[j].rest]) for i in range(2)]
    edges = np.linspace(0.0, max(errors.max() for errors in sets), BINS + 1).tolist()
    for name, errors, colour, hatch in zip(names, sets, (MODEL, HELD_OUT), ("", "///"), strict=True):
        text = f"identified on {name}: mean {errors.mean():.2f}, max {errors.max():.1f} mm"
        kind: Any = {"histtype": "stepfilled", "alpha": 0.45, "color": colour, "edgecolor": colour, "hatch": hatch}
        axes.hist(errors, edges, label=text, **kind)
    axes.set(xlabel="TCP error, mm", ylabel="poses", title=f"measured on {names[j]}, poses not chosen there")
    axes.set_ylim(0, axes.get_ylim()[1] * 1.25)
    axes.legend(loc="upper right", fontsize=8)


def _draw_histogram(axes: Axes, shape: ErrorDistribution, title: str, colour: str) -> None:
    distance = shape.distance * 1e3
    low = min(0.0, (shape.mean - 2.6 * shape.sd) * 1e3)
    edges = np.linspace(0.0, distance.max(), BINS + 1).tolist()
    axes.hist(distance, edges, color=colour, alpha=0.6)
    at = np.linspace(low, distance.max() * 1.05, 200)
    scale = len(distance) * (edges[1] - edges[0]) * 1e-3
    axes.plot(at, shape.density(at * 1e-3) * scale, color="black", linestyle="--", linewidth=1.2, label="Gaussian")
    note = "" if shape.is_gaussian else ", not Gaussian"
    axes.set_title(f"{title}: {distance.mean():.2f} mm{note}", fontsize=10)
    axes.set_xlabel("TCP error, mm", fontsize=8)
    axes.tick_params(labelsize=8)


def _draw_curves(axes: Axes, named: list[tuple[str, Array]], title: str) -> None:
    for number, (name, residual) in enumerate(named):
        shape = error_distribution(residual)
        share = 100 * np.arange(1, len(shape.distance) + 1) / len(shape.distance)
        colour, line = COLOURS[number % len(COLOURS)], LINES[number % len(LINES)]
        text = f"{name}: mean {shape.mean * 1e3:.2f}"
        axes.plot(shape.distance * 1e3, share, color=colour, linestyle=line, linewidth=1.8, label=text)
    axes.set(xlabel="TCP error, mm", ylabel="share of the poses below it, %", ylim=(0, 100), title=title)
    axes.set_xlim(left=0)
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", fontsize=8)


@command
def options(
    data: arg.DataFile,
    other: Annotated[
        Path | None, Argument(metavar="[OTHER]", help="Measurements of the same arm under another load.")
    ] = None,
    arm: arg.ArmName = None,
    poses: Annotated[int, Option("-n", "--poses", min=1, help="How many poses to identify on.")] = POSES,
    only: Annotated[str | None, Option(help="Only these options, by commas, for instance 'option1,option1_2'.")] = None,
    cross_option: Annotated[
        str, Option(help="The option whose parameters are exchanged between DATA and OTHER.")
    ] = "option1_2",
    beside: Annotated[
        str | None, Option(help="Print the thesis's figures beside: no-load or loaded, its two campaigns.")
    ] = None,
    seed: Annotated[int, Option(help="Of the random starts of the search for poses.")] = 0,
    json: arg.JsonFile = None,
    figure: arg.FigureFile = None,
    cross_figure: Annotated[
        Path | None, Option(metavar="FILE", help="Also draw the cross-load histograms: .png, .svg or .pdf.")
    ] = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Compare the thesis's options 1 to 5, 1₂ and 3₂: identify on the best poses, validate on all and on the rest.

    With OTHER, the parameters of each load are also tried on the other one. The rows behind a figure are written
    beside it as .csv.
    """
    if cross_figure and other is None:
        raise LrmError("--cross-figure needs two data sets: DATA and OTHER")
    chosen = OPTIONS if only is None else tuple(option_named(name.strip()) for name in only.split(","))
    campaign = None if beside is None else campaign_named(beside)
    arm_name, the_arm = arm_for(data, arm)
    methods = []
    for measured in [read_measurements(path, the_arm, arm_name, reading) for path in (data, other) if path]:
        with progress(f"options on {measured.path.name}") as tick:
            methods.append(run_options(the_arm, measured, poses, chosen, seed, tick))
        out.rule(measured.path.name)
        show(*method_blocks(methods[-1], campaign if len(methods) == 1 else None))
    crossed = cross_apply(methods[0], methods[1], cross_option) if other else None
    result = options_document(methods, crossed, campaign is not None)
    publish(result, json, figure, partial(draw_method, methods[0]))
    if crossed and cross_figure:
        names = [method.data.path.stem for method in methods]
        publish_figure(cross_figure, partial(draw_crossed, crossed, names), crossed_rows(crossed, names))
