"""Commands before any fit: which parameters poses can tell, and how small a step differences should take."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from lrm_ident.cli.arguments import FigureFile, JsonFile, PosesFile
from lrm_ident.cli.common import app, out, progress
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurements import load_poses
from lrm_ident.design.finite_difference_study import step_study
from lrm_ident.design.observability import UNITS, Units
from lrm_ident.design.parameter_elimination import PUBLISHED_THRESHOLD, eliminate, fittable
from lrm_ident.fit.parameter_sets import THESIS_OPTIONS, chosen
from lrm_ident.report import json_files
from lrm_ident.report.identifiability import (
    elimination_json,
    elimination_rows,
    print_elimination,
    print_steps,
    steps_json,
    steps_rows,
)
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, LrmError, UnknownName
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model

ArmArgument = Annotated[str, typer.Argument(metavar="ARM", help="A shipped arm or the path of an arm file.")]
LinearizedAt = Annotated[
    Path | None,
    typer.Option("--model", metavar="MODEL", help="Linearise about this fitted model instead of the nominal arm."),
]
UnitsName = Annotated[
    str, typer.Option(help="thesis (mm per rad, per mm, per rad/Nmm) or scaled (mm per typical size of a parameter).")
]
THESIS_ANGLES, STUDIED = "0,45,90", ("option1", "option2", "option3")


def start_model(arm: Arm, model: Path | None) -> Model:
    """The nominal arm with the thesis's 45 parameters, or a fitted model of the same arm. Raises `FileError`."""
    if model is None:
        return model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    fitted = load_model(model)
    if fitted.arm != arm:
        raise FileError(model, "arm", f"is a model of {fitted.arm.name}, not of {arm.name}")
    return fitted


def units_named(name: str) -> Units:
    """One of the two kinds of units. Raises `UnknownName`."""
    for units in UNITS:
        if units == name:
            return units
    raise UnknownName("units", name, UNITS)


def check_apart(figure: Path | None, *others: Path | None) -> None:
    """Raises `FileError` if another file has the name under which the numbers behind a figure will be written."""
    behind = None if figure is None else figure.with_suffix(".csv")
    if behind is not None and behind in others:
        raise FileError(behind, "", f"is where the numbers behind {figure} go", "give the two files different names")


def data_behind(figure: Path, rows: str) -> None:
    """Writes the numbers behind a figure beside it."""
    behind = figure.with_suffix(".csv")
    write_text(behind, rows)
    out.print(f"Figure written to {figure}, its data to {behind}")


@app.command()
def identify_parameters(
    arm: ArmArgument,
    poses: PosesFile,
    model: LinearizedAt = None,
    parameters: Annotated[
        str,
        typer.Option(
            help="Which parameters to start from: 'all', option1 (Table 4.5) to option5 of the thesis, or names and "
            "patterns by commas."
        ),
    ] = "all",
    units: UnitsName = "thesis",
    threshold: Annotated[
        float, typer.Option(min=1e-6, help="Smallest singular value that may stay, mm per unit.")
    ] = PUBLISHED_THRESHOLD,
    noise_mm: Annotated[float, typer.Option(min=0.001, help="Noise of the measurement per axis.")] = 0.3,
    json: JsonFile = None,
    figure: FigureFile = None,
) -> None:
    """Find out which parameters poses can tell, before measuring: singular values, and what moves the tip alike.

    Builds the identification Jacobian at POSES, takes parameters out one by one until every singular value reaches the
    threshold (thesis section 4.5), and says of each what it cannot be told from.
    """
    check_apart(figure, json, poses)
    the_arm = load_arm(arm)
    start = start_model(the_arm, model)
    keys = fittable(start) if parameters == "all" else chosen(start, parameters)
    at = load_poses(poses, the_arm)
    found = eliminate(equilibrium(start, at), keys, units_named(units), threshold, noise_mm * 1e-3)
    print_elimination(out, start, found)
    if json:
        write_text(json, json_files.text(elimination_json(found)))
    if figure:
        from lrm_ident.plots.identifiability import draw_elimination  # matplotlib takes half a second to load

        draw_elimination(found, figure)
        data_behind(figure, elimination_rows(found))


@app.command()
def step_size(
    arm: ArmArgument,
    model: LinearizedAt = None,
    angles: Annotated[str, typer.Option(help="Postures to look at, deg: all joints at each angle.")] = THESIS_ANGLES,
    units: UnitsName = "thesis",
    json: JsonFile = None,
    figure: FigureFile = None,
) -> None:
    """Study the step of central differences against the exact derivative (thesis section 4.6, Figures 4.7 and 4.8)."""
    the_arm = load_arm(arm)
    start = start_model(the_arm, model)
    try:
        asked = [float(word) for word in angles.split(",")]
    except ValueError:
        raise LrmError(f"--angles {angles}: not a list of angles in deg such as {THESIS_ANGLES}") from None
    options = {name: [key for key in THESIS_OPTIONS[name] if key in start.keys] for name in STUDIED}
    if not all(options.values()):
        options = {"all": list(fittable(start))}
    kind, free = units_named(units), replace(start, free=fittable(start))
    with progress("differences") as tick:
        studies = step_study(free, options, np.radians(asked).tolist(), kind, progress=tick)
    print_steps(out, studies, kind)
    if json:
        write_text(json, json_files.text(steps_json(studies, kind)))
    if figure:
        from lrm_ident.plots.identifiability import draw_steps

        draw_steps(studies, kind, figure)
        data_behind(figure, steps_rows(studies))
