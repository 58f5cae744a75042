"""Commands that choose poses: which measured ones to identify on, and which to measure next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from lrm_ident.cli.arguments import ArmName, DataFile, EffectsFile, FigureFile, JsonFile
from lrm_ident.cli.common import app, arm_for, out, progress, read_measurements
from lrm_ident.cli.identifiability import ArmArgument, LinearizedAt, check_apart, data_behind, start_model
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurements import load_poses, measurements_csv
from lrm_ident.design.candidate_poses import LEVELS, Rules, combinations, levels_of
from lrm_ident.design.observability import INDICES, Index
from lrm_ident.design.pose_design import Offer, Task
from lrm_ident.design.pose_design import design as run_design
from lrm_ident.design.pose_selection import choose
from lrm_ident.effect_plugins import catalogue_with
from lrm_ident.fit.parameter_sets import chosen
from lrm_ident.report import json_files
from lrm_ident.report.design import (
    choice_json,
    choice_rows,
    design_csv,
    design_json,
    knowledge_rows,
    print_choice,
    print_design,
)
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import GRAM, MM, load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.poses import Poses

Count = Annotated[int, typer.Option("-n", "--count", min=1, help="How many poses to choose.")]
IndexName = Annotated[str, typer.Option(help="What to raise: O1 (determinant), O2, O3, O4 or O5 (docs/design.md).")]
Seed = Annotated[int, typer.Option(help="Of the random starts.")]
Chosen = Annotated[
    str, typer.Option(help="Which parameters: option1 to option5 of the thesis, or names and patterns by commas.")
]
PosesOutput = Annotated[Path | None, typer.Option("-o", "--output", metavar="CSV", help="Where to write the poses.")]
MOST_CANDIDATES = 6000  # more are thinned out at random; the best index hardly changes


def index_named(name: str) -> Index:
    """One of the five indices. Raises `UnknownName`."""
    for index in INDICES:
        if index == name.upper():
            return index
    raise UnknownName("index", name, INDICES)


@app.command()
def choose_poses(
    data: DataFile,
    arm: ArmName = None,
    count: Count = 50,
    parameters: Chosen = "option1",
    index: IndexName = "O1",
    physical: Annotated[
        bool,
        typer.Option(
            "--physical", help="Only sets whose own unbounded fit keeps physical signs (thesis Figure 6.3; O1 only)."
        ),
    ] = False,
    seed: Seed = 0,
    output: PosesOutput = None,
    json: JsonFile = None,
    figure: FigureFile = None,
) -> None:
    """Choose, among measured poses, those that identify parameters best (thesis section 6.2), and identify on them.

    Prints the five indices beside those of blind choices and, for O1, the value that no choice can exceed; then the
    error on all poses and on those not chosen, fitted without bounds and with bounds.
    """
    check_apart(figure, output, json, data)
    arm_name, the_arm = arm_for(data, arm)
    measured = read_measurements(data, the_arm, arm_name)
    kind = index_named(index)
    if physical and kind != "O1":
        raise LrmError("--physical follows the identification along the determinant: it goes with --index O1 only")
    nominal = start_model(the_arm, None)
    model = replace(nominal, free=chosen(nominal, parameters))
    with progress("exchanging poses") as tick:
        found = choose(model, measured, count, kind, physical, seed, tick)
    print_choice(out, model, found, measured)
    if json:
        write_text(json, json_files.text(choice_json(found, measured)))
    if figure:
        from lrm_ident.plots.design import draw_choice  # matplotlib takes half a second to load

        draw_choice(found, measured, figure)
        data_behind(figure, choice_rows(found, measured))
    if output:
        write_text(output, measurements_csv(measured.take(found.rows)))
        out.print(f"{count} measurements written to {output}")


@app.command()
def design(
    arm: ArmArgument,
    poses: Annotated[
        Path | None,
        typer.Option("--poses", metavar="CSV", help="Candidates; else all combinations of --levels that keep clear."),
    ] = None,
    count: Count = 50,
    separate: Annotated[
        str | None, typer.Option(help="Effects to tell apart, by commas: backlash@joint2,nonlinear_stiffness@joint2.")
    ] = None,
    model: LinearizedAt = None,
    parameters: Annotated[
        str,
        typer.Option(
            help="What is to be known: 'identifiable' (all that the candidates can tell), option1 to option5, or names "
            "and patterns by commas."
        ),
    ] = "identifiable",
    index: IndexName = "O1",
    have: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Poses measured already, in the order measured."),
    ] = None,
    levels: Annotated[
        str,
        typer.Option(help="Levels of the joints: a count, or deg, for instance '5; joint2=-50,0,50; joint6=3'."),
    ] = str(LEVELS),
    loads_g: Annotated[str, typer.Option(help="Loads at the tool, by commas; each is offered with every pose.")] = "0",
    repeats: Annotated[int, typer.Option(min=0, help="How many of the poses to measure twice, for the noise.")] = 5,
    noise_mm: Annotated[float, typer.Option(min=0.001, help="Noise of the measurement per axis.")] = 0.3,
    apart_mm: Annotated[float, typer.Option(min=0, help="Bodies stay this far from each other.")] = 30.0,
    tip_mm: Annotated[float, typer.Option(min=0, help="The TCP stays this far from the inner arm and boxes.")] = 160.0,
    floor_mm: Annotated[float | None, typer.Option(help="Lowest z of joints and TCP; none if not given.")] = None,
    seed: Seed = 0,
    output: PosesOutput = None,
    json: JsonFile = None,
    figure: FigureFile = None,
    effects_file: EffectsFile = None,
) -> None:
    """Choose the poses to measure next: those that make parameters known, and tell rival effects apart.

    Writes a pose file in the order to measure: from which side to approach each pose, a few of them twice. Prints what
    it will tell, beside as many poses drawn blindly.
    """
    check_apart(figure, output, json, poses, have)
    the_arm = load_arm(arm)
    start = start_model(the_arm, model)
    measured = None if have is None else load_poses(have, the_arm)
    catalogue = catalogue_with(effects_file)
    names = [name.strip() for name in (separate or "").split(",") if name.strip()]
    rules = Rules(apart_mm * MM, tip_mm * MM, None if floor_mm is None else floor_mm * MM)
    offer = _offer(the_arm, poses, levels, loads_g, rules, seed)
    if names and index_named(index) != "O1":
        raise LrmError("--separate raises determinants: it goes with --index O1 only")
    task = Task(
        model=start,
        keys=None if parameters == "identifiable" else chosen(start, parameters),
        rivals=tuple(effect for name in names for effect in effects_at(the_arm, name, catalogue)),
        count=count,
        index=index_named(index),
        noise=noise_mm * MM,
        have=measured,
        repeats=repeats,
        first=1 if measured is None else max(measured.names(np.arange(len(measured)))) + 1,
        seed=seed,
    )
    with progress("exchanging poses") as tick:
        found = run_design(task, offer.poses, tick)
    print_design(out, task, offer, found)
    if json:
        write_text(json, json_files.text(design_json(task, offer, found)))
    if figure:
        from lrm_ident.plots.design import draw_design  # matplotlib takes half a second to load

        draw_design(task, offer, found, figure)
        data_behind(figure, knowledge_rows(found))
    if output:
        write_text(output, design_csv(found))
        out.print(f"{len(found.poses)} poses written to {output}, in the order to measure them")
    else:
        out.print("Not saved; give -o POSES.csv to keep it.")


def _offer(arm: Arm, poses: Path | None, levels: str, loads: str, rules: Rules, seed: int) -> Offer:
    """The candidates: of a file, or all combinations that keep the rules, under every load."""
    try:
        payloads = [float(word) * GRAM for word in loads.split(",")]
    except ValueError:
        raise LrmError(f"--loads-g {loads}: not a list of loads in g such as 0,66.3") from None
    if min(payloads) < 0:
        raise LrmError(f"--loads-g {loads}: a negative load")
    if poses is not None:
        given = replace(load_poses(poses, arm), direction=None, number=None)
        return Offer(Poses(given.q, given.payload), f"{len(given)} poses of {poses.name}", {})
    clear = combinations(arm, levels_of(arm, levels), rules)
    q = clear.q
    most = MOST_CANDIDATES // len(payloads)
    words = f"{len(q)} of {clear.tried} combinations of levels keep clear"
    if len(q) > most:
        q = q[np.sort(np.random.default_rng(seed).choice(len(q), most, replace=False))]
        words += f"; {most} of them, drawn at random, are looked at"
    if not arm.shapes.capsules:
        words += "; the arm has no shapes, so only the lines between its joints were held to the rules"
    every = Poses(np.tile(q, (len(payloads), 1)), np.repeat(payloads, len(q)))
    return Offer(every, words, clear.refused)
