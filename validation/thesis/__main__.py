"""The method of the thesis (Conenna 2024, chapter 6) on any data set: `python -m validation.thesis DATA [OTHER]`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.app import run
from lrm_ident.cli.command import command_of
from lrm_ident.cli.common import progress, publish, publish_figure, read_measurements, show
from lrm_ident.cli.consoles import out
from lrm_ident.data.measurement_file.conventions import arm_for
from lrm_math.errors import LrmError
from lrm_math.model.reading import AS_NAMED, Reading
from validation.thesis.options_figures import draw_crossed, draw_method
from validation.thesis.options_report import crossed_rows, method_blocks, options_document
from validation.thesis.thesis_options import OPTIONS, POSES, cross_apply, option_named, run_options
from validation.thesis.thesis_results import campaign_named


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
        with progress(f"options on {measured.source.path.name}") as tick:
            methods.append(run_options(the_arm, measured, poses, chosen, seed, tick))
        out.rule(measured.source.path.name)
        show(*method_blocks(methods[-1], campaign if len(methods) == 1 else None))
    crossed = cross_apply(methods[0], methods[1], cross_option) if other else None
    result = options_document(methods, crossed, campaign is not None)
    publish(result, json, figure, partial(draw_method, methods[0]))
    if crossed and cross_figure:
        names = [method.data.source.path.stem for method in methods]
        publish_figure(cross_figure, partial(draw_crossed, crossed, names), crossed_rows(crossed, names))


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
command_of(app)(options)


def main() -> None:
    """Runs the command; every expected error is one line on stderr and exit code 2."""
    run(app)


if __name__ == "__main__":
    main()
