"""The command `step-size`: how small a step finite differences should take."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Annotated

import numpy as np
from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.common import one_of, progress, publish, start_model
from lrm_ident.design.observability import UNITS
from lrm_ident.fitting.parameter_sets import THESIS_OPTIONS, fittable
from lrm_math.arm.arm_file import load_arm
from lrm_math.number_list import parse_numbers
from validation.thesis.application import command
from validation.thesis.finite_difference_study import study_step_sizes
from validation.thesis.step_size_figure import draw_steps
from validation.thesis.step_size_report import steps_document

THESIS_ANGLES, STUDIED = "0,45,90", ("option1", "option2", "option3")


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
