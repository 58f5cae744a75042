"""The command `step-size`: how small a step finite differences should take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.common import one_of, progress, publish, start_model
from lrm_ident.design.observability import UNITS, Units
from lrm_ident.fitting.parameter_sets import THESIS_OPTIONS, fittable
from lrm_ident.report.document import Block, Document, ResultTable
from lrm_ident.report.plots.style import GREEN, HELD_OUT, MODEL, figure_file
from lrm_math.arm.arm_file import load_arm
from lrm_math.number_list import parse_numbers
from validation.thesis.finite_difference_study import MAX_RELATIVE_ERROR, StepSizeStudy, study_step_sizes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

THESIS_STEP = 1e-9  # Conenna 2024, section 4.6
STYLES = {"option1": (MODEL, "-"), "option2": (HELD_OUT, "--"), "option3": (GREEN, ":"), "all": (MODEL, "-")}


def draw_steps(studies: Sequence[StepSizeStudy], units: Units, path: Path) -> None:
    """Norm over exact norm, and error, by step; a column for each posture. Raises `FileError`."""
    angles = list(dict.fromkeys(study.angle for study in studies))
    with figure_file(path, 4.4 * len(angles), 6.4) as figure:
        panels = figure.subplots(2, len(angles), sharex=True, sharey="row", squeeze=False)
        for column, angle in enumerate(angles):
            here = [study for study in studies if study.angle == angle]
            _draw_norm(panels[0, column], here)
            _draw_error(panels[1, column], here, THESIS_STEP if units == "thesis" else None)
            panels[0, column].set_title(f"all joints at {np.degrees(angle):.0f} deg", fontsize=10)
        panels[0, 0].set_ylabel("norm by differences / exact norm")
        panels[1, 0].set_ylabel("relative error of the Jacobian")


def _draw_norm(axes: Axes, studies: Sequence[StepSizeStudy]) -> None:
    for study in studies:
        colour, line = STYLES[study.option]
        label = f"{study.option}: exact {study.exact:.3g}"
        axes.plot(study.steps, study.norm / study.exact, color=colour, linestyle=line, linewidth=2, label=label)
    axes.set(ylim=(0.8, 1.3))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9)


def _draw_error(axes: Axes, studies: Sequence[StepSizeStudy], published: float | None) -> None:
    for study in studies:
        colour, line = STYLES[study.option]
        axes.plot(study.steps, study.error, color=colour, linestyle=line, linewidth=2)
    if published is not None:
        axes.axvline(published, color="black", linewidth=1, linestyle="-.")
        axes.text(1.3 * published, 0.2, f"thesis: {published:g}", fontsize=9)
    axes.set(xscale="log", yscale="log", xlabel="step ε")
    axes.grid(alpha=0.3)


def steps_document(studies: Sequence[StepSizeStudy], units: str) -> Document:
    """Result of `step-size`, schema `lrm/step-size/1`; its figure shows norm and error by step."""
    words = "rad, mm, rad/Nmm" if units == "thesis" else "typical sizes"
    good = f"error < {MAX_RELATIVE_ERROR:g} from … to|"
    columns = ("joints at", "parameters", "norm|.4g", "best step|.0e", "error|.0e", good)
    rows = []
    for study in studies:
        span = "never" if study.usable_range is None else "{:.0e} … {:.0e}".format(*study.usable_range)
        rows.append((f"{np.degrees(study.angle):.0f} deg", study.option, study.exact, *study.best, span))
    blocks: list[Block] = [ResultTable(columns, rows, f"Central differences, steps in {words}"), _common_span(studies)]
    collapsed = min((step for study in studies for step in study.no_equilibrium), default=None)
    if collapsed is not None:
        blocks.append(f"From {collapsed:.0e} on the arm collapses: a compliance that large has no equilibrium.")
    values = {
        "units": units,
        "studies": [
            {
                "joints_deg": round(float(np.degrees(study.angle)), 9),
                "parameters": study.option,
                "exact_norm": study.exact,
                "best_step": study.best[0],
                "best_relative_error": study.best[1],
                "good_steps": study.usable_range,
                "steps": study.steps,
                "norm": study.norm,
                "relative_error": study.error,
            }
            for study in studies
        ],
    }
    behind = ResultTable(
        ("joints_deg|g", "parameters", "step|.6g", "norm|.12g", "relative_error|.6g"),
        [
            (np.degrees(study.angle), study.option, *row)
            for study in studies
            for row in zip(study.steps, study.norm, study.error, strict=True)
        ],
    )
    return Document(blocks, "lrm/step-size/1", values, behind)


def _common_span(studies: Sequence[StepSizeStudy]) -> str:
    spans = [study.usable_range for study in studies if study.usable_range is not None]
    low, high = max((span[0] for span in spans), default=np.inf), min((span[1] for span in spans), default=0.0)
    if len(spans) == len(studies) and low <= high:
        return f"One step for all of them: {low:.0e} to {high:.0e}."
    return "No one step is good for all of them."


THESIS_ANGLES, STUDIED = "0,45,90", ("option1", "option2", "option3")


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
