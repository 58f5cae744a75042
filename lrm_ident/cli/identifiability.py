"""Commands before any fit: which parameters poses identify, and how small a step finite differences should take."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Annotated

import numpy as np
from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import check_distinct, one_of, parse_numbers, progress, publish, start_model
from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.design.finite_difference_study import study_step_sizes
from lrm_ident.design.observability import UNITS
from lrm_ident.design.parameter_elimination import PUBLISHED_THRESHOLD, eliminate, fittable
from lrm_ident.estimation.parameter_sets import THESIS_OPTIONS, select_parameters
from lrm_ident.plots.identifiability import draw_elimination, draw_steps
from lrm_ident.report.identifiability import elimination_document, steps_document
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.model.equilibrium import equilibrium

THESIS_ANGLES, STUDIED = "0,45,90", ("option1", "option2", "option3")


@command
def identify_parameters(
    arm: arg.ArmArgument,
    poses: arg.PosesFile,
    model: arg.LinearizedAt = None,
    parameters: Annotated[
        str,
        Option(
            help="Which parameters to start from: 'all', option1 (Table 4.5) to option5 of the thesis, or names and "
            "patterns by commas."
        ),
    ] = "all",
    units: arg.UnitsName = "thesis",
    threshold: Annotated[
        float, Option(min=1e-6, help="Smallest singular value that may stay, mm per unit.")
    ] = PUBLISHED_THRESHOLD,
    noise_mm: arg.NoiseMm = 0.3,
    json: arg.JsonFile = None,
    figure: arg.FigureFile = None,
) -> None:
    """Find out which parameters poses can tell, before measuring: singular values, and what moves the tip alike.

    Builds the identification Jacobian at POSES, takes parameters out one by one until every singular value reaches the
    threshold (thesis section 4.5), and says of each what it cannot be told from.
    """
    check_distinct(figure, json, poses)
    the_arm = load_arm(arm)
    start = start_model(the_arm, model)
    keys = fittable(start) if parameters == "all" else select_parameters(start, parameters)
    rest = equilibrium(start, load_poses(poses, the_arm))
    found = eliminate(rest, keys, one_of("units", units, UNITS), threshold, noise_mm * MM)
    publish(elimination_document(start, found), json, figure, partial(draw_elimination, found))


@command
def step_size(
    arm: arg.ArmArgument,
    model: arg.LinearizedAt = None,
    angles: Annotated[str, Option(help="Postures to look at, deg: all joints at each angle.")] = THESIS_ANGLES,
    units: arg.UnitsName = "thesis",
    json: arg.JsonFile = None,
    figure: arg.FigureFile = None,
) -> None:
    """Study the step of central differences against the exact derivative (thesis section 4.6, Figures 4.7 and 4.8)."""
    start = start_model(load_arm(arm), model)
    q = np.radians(parse_numbers("--angles", angles, f"a list of angles in deg such as {THESIS_ANGLES}")).tolist()
    options = {name: [key for key in THESIS_OPTIONS[name] if key in start.keys] for name in STUDIED}
    if not all(options.values()):
        options = {"all": list(fittable(start))}
    kind = one_of("units", units, UNITS)
    with progress("differences") as tick:
        studies = study_step_sizes(replace(start, free=fittable(start)), options, q, kind, progress=tick)
    publish(steps_document(studies, kind), json, figure, partial(draw_steps, studies, kind))
