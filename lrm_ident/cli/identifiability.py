"""Command before any fit: which parameters poses identify."""

from __future__ import annotations

from functools import partial
from typing import Annotated

from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import one_of, publish, start_model
from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.design.observability import UNITS
from lrm_ident.design.parameter_elimination import PUBLISHED_THRESHOLD, eliminate, fittable
from lrm_ident.fitting.parameter_sets import select_parameters
from lrm_ident.report.identifiability import elimination_document
from lrm_ident.report.plots.identifiability import draw_elimination
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.model.equilibrium import equilibrium


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
    figure: arg.FigureAndNumbers = None,
) -> None:
    """Find out which parameters poses can tell, before measuring: singular values, and what moves the tip alike.

    Builds the identification Jacobian at POSES, takes parameters out one by one until every singular value reaches the
    threshold (thesis section 4.5), and says of each what it cannot be told from.
    """
    the_arm = load_arm(arm)
    start = start_model(the_arm, model)
    keys = fittable(start) if parameters == "all" else select_parameters(start, parameters)
    rest = equilibrium(start, load_poses(poses, the_arm))
    found = eliminate(rest, keys, one_of("units", units, UNITS), threshold, noise_mm * MM)
    publish(elimination_document(start, found), json, figure, partial(draw_elimination, found))
