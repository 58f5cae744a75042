"""Commands that follow the thesis: the options tables, the preliminary tests."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lrm_ident.cli.arguments import ArmName, DataFile, FigureFile, JsonFile
from lrm_ident.cli.common import app, arm_for, out, progress, read_measurements
from lrm_ident.data.atomic_write import write_text
from lrm_ident.report import json_files
from lrm_ident.report.thesis import crossed_json, crossed_rows, error_rows, method_json, print_crossed, print_method
from lrm_ident.thesis.thesis_options import OPTIONS, POSES, cross, option_named, run_method
from lrm_ident.thesis.thesis_results import campaign_named
from lrm_math.errors import LrmError


@app.command()
def options(
    data: DataFile,
    other: Annotated[
        Path | None, typer.Argument(metavar="[OTHER]", help="Measurements of the same arm under another load.")
    ] = None,
    arm: ArmName = None,
    poses: Annotated[int, typer.Option("-n", "--poses", min=1, help="How many poses to identify on.")] = POSES,
    only: Annotated[
        str | None, typer.Option(help="Only these options, by commas, for instance 'option1,option1_2'.")
    ] = None,
    cross_option: Annotated[
        str, typer.Option(help="The option whose parameters are exchanged between DATA and OTHER.")
    ] = "option1_2",
    beside: Annotated[
        str | None, typer.Option(help="Print the thesis's figures beside: no-load or loaded, its two campaigns.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of the random starts of the search for poses.")] = 0,
    json: JsonFile = None,
    figure: FigureFile = None,
    cross_figure: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also draw the cross-load histograms: .png, .svg or .pdf.")
    ] = None,
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
    measured = [read_measurements(path, the_arm, arm_name) for path in (data, other) if path]
    methods = []
    for one in measured:
        with progress(f"options on {one.path.name}") as tick:
            methods.append(run_method(the_arm, one, poses, chosen, seed, tick))
        out.rule(one.path.name)
        print_method(out, methods[-1], campaign if len(methods) == 1 else None)
    tables = {"schema": "lrm/options/1", "data_sets": [method_json(method) for method in methods]}
    if len(methods) == 2:
        crossed, names = cross(methods[0], methods[1], cross_option), (measured[0].path.stem, measured[1].path.stem)
        print_crossed(out, crossed, names, campaign is not None)
        tables["cross_load"] = crossed_json(crossed, names)
    if json:
        write_text(json, json_files.text(tables))
    if figure:
        from lrm_ident.plots.thesis import draw_method  # matplotlib takes half a second to load

        draw_method(methods[0], figure)
        _data_behind(figure, error_rows(methods[0]))
    if cross_figure:
        from lrm_ident.plots.thesis import draw_crossed

        draw_crossed(crossed, names, cross_figure)
        _data_behind(cross_figure, crossed_rows(crossed, names))


def _data_behind(figure: Path, rows: str) -> None:
    behind = figure.with_suffix(".csv")
    write_text(behind, rows)
    out.print(f"Figure written to {figure}, its data to {behind}")
