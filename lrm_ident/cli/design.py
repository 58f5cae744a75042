"""Commands that choose poses, measured ones and the next ones, and what poses can tell of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import notice, one_of, progress, publish, read_measurements, read_poses, show, start_model
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.conventions import arm_for
from lrm_ident.data.measurement_file.load import says_measured
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.set_up import with_set_up
from lrm_ident.data.weights.whitening import PLAIN, Whitening, measured_alike
from lrm_ident.design.advice import IndistinguishableByOffer, next_poses
from lrm_ident.design.candidate_poses import (
    ANY,
    ClearanceRules,
    clear_poses,
    floor_above_table,
    lowest_point,
    parse_levels,
)
from lrm_ident.design.installation import FEW
from lrm_ident.design.observability import INDICES, UNITS
from lrm_ident.design.parameter_elimination import PUBLISHED_THRESHOLD, eliminate
from lrm_ident.design.pose_design import CandidateSet, DesignProblem
from lrm_ident.design.pose_selection import select_poses
from lrm_ident.fitting.effect_plugins import catalogue_with
from lrm_ident.fitting.executors import executor_for, in_this_process
from lrm_ident.fitting.identifiability import fit_identifiable, select_identifiable
from lrm_ident.fitting.parameter_sets import TABLE_4_5, fittable, select_parameters
from lrm_ident.fitting.transfer import TransferredModel, transferred
from lrm_ident.measuring.camera.session import CameraSession, expected_weights, visible
from lrm_ident.report.design import choice_document, design_document, elimination_document, pose_table
from lrm_ident.report.plots.design import draw_choice, draw_design, draw_elimination
from lrm_ident.report.text.advice import advice_sentence, plan_options
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import GRAM, MM, load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile, load_covariance, load_model
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.number_list import parse_numbers
from lrm_math.toml_file import read_toml

MANY, REPEATS = 50, 5
NEGLIGIBLE = 1e-6
"""m below a plane."""


@command
def choose_poses(
    data: arg.DataFile,
    arm: arg.ArmName = None,
    count: arg.Count = 50,
    parameters: Annotated[
        str,
        Option(
            help="Which parameters: 'identifiable' (all that these data determine), option1 to option5 of the thesis, "
            "or names and patterns by commas. Default: option1 if the arm has its parameters, else identifiable."
        ),
    ] = "",
    index: arg.IndexName = "O1",
    physical: Annotated[
        bool,
        Option("--physical", help="Only sets whose unbounded fit has physical signs (thesis Figure 6.3; O1 only)."),
    ] = False,
    seed: arg.Seed = 0,
    output: arg.PosesOutput = None,
    json: arg.JsonFile = None,
    figure: arg.FigureAndNumbers = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Choose the best poses among measured ones: those that identify parameters best (thesis section 6.2).

    Prints the five indices beside those of random choices and, for O1, the value that no choice can exceed. Then it
    prints the error on all poses and on those not chosen, fitted without and with bounds.
    """
    arm_name, the_arm = arm_for(data, arm)
    measured = read_measurements(data, the_arm, arm_name, reading)
    kind = one_of("index", index.upper(), INDICES)
    if physical and kind != "O1":
        raise LrmError("--physical follows the identification along the determinant: it goes with --index O1 only")
    nominal = with_set_up(start_model(the_arm, None), measured)
    keys = _parameters_of(nominal, parameters, measured)
    model = replace(nominal, free=(*keys, *(key for key in nominal.free if key not in keys)))
    with progress("exchanging poses") as tick:
        selection = select_poses(model, measured, count, kind, physical, seed, tick)
    placed = measured.with_tcp(measured.places(solve_equilibrium(model, measured.poses)))
    publish(choice_document(model, selection, placed), json, figure, partial(draw_choice, selection, placed))
    if output:
        write_text(output, measurements_csv(measured.take(selection.rows)))
        show(f"{count} measurements written to {output}")


@command
def design(
    arm: arg.ArmArgument,
    poses: Annotated[
        Path | None,
        Option(
            "--poses",
            metavar="CSV",
            help="Candidate poses. Default: those of --levels that keep clear of obstacles.",
        ),
    ] = None,
    count: Annotated[
        int | None,
        Option("-n", "--count", min=1, help="How many poses to choose. Default: 50, with --installation 6."),
    ] = None,
    installation: Annotated[
        bool,
        Option(
            "--installation",
            help="Choose poses that determine only base, tool and gravity. The arm is known from --model of a bench "
            "(lrm-ident transfer).",
        ),
    ] = False,
    separate: Annotated[
        str | None, Option(help="Effects to distinguish, by commas: backlash@joint2,nonlinear_stiffness@joint2.")
    ] = None,
    model: arg.LinearizedAt = None,
    parameters: Annotated[
        str,
        Option(
            help="Parameters to determine: 'identifiable' (all that the candidates determine), option1 to option5, or "
            "names and patterns by commas."
        ),
    ] = "identifiable",
    index: arg.IndexName = "O1",
    have: Annotated[
        Path | None,
        Option(
            metavar="CSV",
            help="Poses measured already, in the order measured. They are weighted by what the file has of them: "
            "standard deviations, orientations, joint feedback, distances.",
        ),
    ] = None,
    like: Annotated[
        Path | None,
        Option(
            metavar="DATA",
            help="Measurements like those to come: the poses are weighted like these. Default: as --have.",
        ),
    ] = None,
    camera: Annotated[
        Path | None,
        Option(metavar="SESSION", help="Only poses that show the board to this camera (DATA.camera.toml)."),
    ] = None,
    levels: Annotated[
        str,
        Option(
            help="Angles to combine for each joint: how many, or which (deg): '5; joint2=-50,0,50; joint6=3'; or any: "
            "random poses at any angles."
        ),
    ] = ANY,
    loads_g: Annotated[str, Option(help="Loads at the tool, by commas. Every pose is offered with each load.")] = "0",
    repeats: Annotated[
        int | None,
        Option(min=0, help="How many of the poses to measure twice, for the noise. Default: 5, with --installation 0."),
    ] = None,
    noise_mm: arg.NoiseMm = 0.3,
    apart_mm: Annotated[float, Option(min=0, help="Smallest distance between two bodies.")] = 30.0,
    tip_mm: Annotated[float, Option(min=0, help="Smallest distance of the TCP from the inner arm and boxes.")] = 160.0,
    floor_mm: Annotated[
        str,
        Option(
            help="Lowest z of joints and TCP in the arm's frame, or none. Default: --apart-mm above the table that the "
            "arm file states; of the shipped arms so100, so101, koch and lekiwi state one."
        ),
    ] = "",
    seed: arg.Seed = 0,
    output: arg.PosesOutput = None,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
    figure: arg.FigureAndNumbers = None,
    effects_file: arg.EffectsFile = None,
    cluster: arg.Cluster = None,
) -> None:
    """Choose the poses to measure next: those that determine parameters and distinguish candidate effects.

    Writes a pose file in the order to measure: from which side to approach each pose, a few of them twice. Prints what
    they will determine, beside as many random poses.
    """
    the_arm = load_arm(arm)
    mounted = _mounted(the_arm, model, noise_mm * MM) if installation else None
    start = start_model(the_arm, model) if mounted is None else mounted.model
    if installation and parameters != "identifiable":
        raise LrmError("--installation says which parameters: leave out --parameters")
    if camera is not None and like is not None:
        raise LrmError("--camera says how poses will be measured: leave out --like")
    usual = None if model is None else _reading_of(model)
    measured_before = None if have is None else _measured(have, the_arm, arm, usual)
    alike = measured_before if like is None else _measured(like, the_arm, arm, usual)
    measured = None if have is None else _commanded(have, the_arm, measured_before)
    for poses_file in (measured_before, alike):
        start = start if poses_file is None else with_set_up(start, poses_file)
    catalogue = catalogue_with(effects_file)
    names = [name.strip() for name in (separate or "").split(",") if name.strip()]
    rules = ClearanceRules(apart_mm * MM, tip_mm * MM, _floor(floor_mm, the_arm, apart_mm * MM))
    session = None if camera is None else read_toml(camera, CameraSession)
    movable = the_arm if mounted is None else mounted.measured_arm
    loads = _loads(loads_g)
    kind = one_of("index", index.upper(), INDICES)
    if names and kind != "O1":
        raise LrmError("--separate raises determinants: it goes with --index O1 only")
    task = DesignProblem(
        model=start,
        keys=_keys(start, parameters) if mounted is None else mounted.covariance.keys,
        rivals=tuple(effect for name in names for effect in effects_at(the_arm, name, catalogue)),
        count=count or (FEW if installation else MANY),
        index=kind,
        noise=noise_mm * MM,
        measured=measured,
        repeats=(0 if installation else REPEATS) if repeats is None else repeats,
        first_number=_next_number(measured, measured_before),
        seed=seed,
        weights=_weights(session, alike, the_arm),
        measured_weights=None if measured_before is None else measured_before.whitening,
        prior=None if mounted is None else mounted.covariance,
    )
    with executor_for(cluster, effects_file) if cluster else in_this_process() as pool, progress("exchanging") as tick:
        offer = _offer(movable, poses, levels, loads, rules, seed, session)
        try:
            offered = next_poses(task, offer, tick, pool)
        except IndistinguishableByOffer as error:
            plan = error.advice.plan if error.advice.helps else None
            options = "" if plan is None else f" (--separate … {plan_options(plan)})"
            raise LrmError(f"{error}. {advice_sentence(error.advice)}{options}") from None
    publish(design_document(task, offer, offered), json, figure, partial(draw_design, task, offer, offered), show_all)
    if floor_mm != "none":
        _say_floor(movable, offered.poses.q, None if poses is not None else rules.floor)
    if output:
        write_text(output, pose_table(offered).csv())
        show(f"{len(offered.poses)} poses written to {output}, in the order to measure them")
    else:
        show("Not saved; give -o POSES.csv to keep it.")


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
        float, Option(min=1e-6, help="Smallest singular value that a kept parameter may have, mm per unit.")
    ] = PUBLISHED_THRESHOLD,
    noise_mm: arg.NoiseMm = 0.3,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
    figure: arg.FigureAndNumbers = None,
) -> None:
    """List the parameters that a set of poses determines, before measuring: singular values, and collinear parameters.

    Builds the identification Jacobian at POSES, takes parameters out one by one until every singular value reaches the
    threshold (thesis section 4.5). Prints which combination of the others moves the tip as each of these does.
    """
    the_arm = load_arm(arm)
    start = start_model(the_arm, model)
    keys = fittable(start) if parameters == "all" else select_parameters(start, parameters)
    settled = solve_equilibrium(start, read_poses(poses, the_arm))
    elimination = eliminate(settled, keys, one_of("units", units, UNITS), threshold, noise_mm * MM)
    publish(elimination_document(start, elimination), json, figure, partial(draw_elimination, elimination), show_all)


def _parameters_of(model: Model, parameters: str, data: Measurements) -> tuple[str, ...]:
    """The parameters to choose poses for. Raises `UnknownName`."""
    if not parameters:
        parameters = "option1" if set(TABLE_4_5) <= set(model.keys) else "identifiable"
    if parameters != "identifiable":
        return select_parameters(model, parameters)
    fit = fit_identifiable(model, data, fittable(model)).fit
    return select_identifiable(fit.equilibrium, fit.model.free, fit.sigma, data.whitening).kept


def _keys(model: Model, parameters: str) -> tuple[str, ...] | None:
    """The parameters to choose poses for; None: all that the candidates determine. Raises `UnknownName`."""
    return None if parameters == "identifiable" else select_parameters(model, parameters)


def _mounted(arm: Arm, bench: Path | None, noise: float) -> TransferredModel:
    """The arm where it stands now: known from a bench, or as drawn. Raises `FileError`, `LrmError`: another arm."""
    if bench is None:
        return transferred(start_model(arm, None), None, arm, noise)
    return transferred(load_model(bench), load_covariance(bench), arm, noise)


def _reading_of(model: Path) -> Reading | None:
    """How the data of a model's fit were read. Raises `FileError`."""
    provenance = read_toml(model, ModelFile).provenance
    return None if provenance is None else provenance.reading


def _measured(path: Path, arm: Arm, arm_name: str, usual: Reading | None) -> Measurements | None:
    """Measured poses of a file, read as `usual` where it states nothing; None if it has commands alone.

    Raises `FileError`.
    """
    return read_measurements(path, arm, arm_name, usual=usual) if says_measured(path) else None


def _commanded(path: Path, arm: Arm, measured: Measurements | None) -> Poses:
    """The commands of a file; those of its measured poses, if there are any. Raises `FileError`."""
    return read_poses(path, arm) if measured is None else measured.poses


def _next_number(commanded: Poses | None, measured: Measurements | None) -> int:
    """The first number of a pose that no earlier one has, those left out included."""
    taken: Sequence[int] = () if commanded is None else commanded.names(np.arange(len(commanded)))
    return max((0, *taken, *(() if measured is None else measured.source.left_out))) + 1


def _weights(camera: CameraSession | None, alike: Measurements | None, arm: Arm) -> Callable[[Poses], Whitening]:
    """The weights with which poses will be measured: by the camera, as others were, or all alike."""
    if camera is not None:
        return partial(expected_weights, camera, arm)
    return measured_alike(PLAIN if alike is None else alike.whitening)


def _loads(text: str) -> list[float]:
    """Loads (kg) of `--loads-g`. Raises `LrmError`."""
    payloads = [load * GRAM for load in parse_numbers("--loads-g", text, "a list of loads in g such as 0,66.3")]
    if min(payloads) < 0:
        raise LrmError(f"--loads-g {text}: a negative load")
    return payloads


def _offer(
    arm: Arm,
    poses: Path | None,
    levels: str,
    payloads: Sequence[float],
    rules: ClearanceRules,
    seed: int,
    camera: CameraSession | None,
) -> CandidateSet:
    """The candidates: of a file, or all combinations that keep the rules, under every load."""
    if poses is not None:
        given = replace(read_poses(poses, arm), direction=None, number=None)
        words = f"{len(given)} poses of {poses.name}"
        if camera is not None:
            given = given.take(visible(camera, arm, given))
            words += f", {len(given)} of which show the board to the camera"
        return CandidateSet(Poses(given.q, given.payload), words, {})
    narrowed = None if camera is None else partial(_in_view, camera, arm)
    return clear_poses(arm, parse_levels(arm, levels), payloads, rules, seed, narrowed)


def _floor(text: str, arm: Arm, apart: float) -> float | None:
    """Lowest z (m) of `--floor-mm`; if it is empty, that far above the arm's table. Raises `LrmError`."""
    if not text:
        return floor_above_table(arm, apart)
    if text == "none":
        return None
    (lowest,) = parse_numbers("--floor-mm", text, "a height in mm such as 30, or none", count=1)
    return lowest * MM


def _say_floor(arm: Arm, q: Array, floor: float | None) -> None:
    """Says which floor the chosen angles (N, n), rad, keep; without one, that some go below what the arm stands on."""
    if floor is not None:
        show(f"Joints and TCP stay above z = {floor / MM:g} mm (--floor-mm none: no floor).")
        return
    lowest, plane = lowest_point(arm, q), arm.table or 0.0
    if lowest < plane - NEGLIGIBLE and not arm.shapes.boxes:
        notice(
            f"some poses go down to z = {lowest / MM:.1f} mm. If the arm stands on a table at z = {plane / MM:g} mm, "
            "it would hit that: choose them with --floor-mm 30"
        )


def _in_view(camera: CameraSession, arm: Arm, q: Array) -> Array:
    """The angles at which the camera sees the board. Raises `LrmError` if there are none."""
    seen = q[visible(camera, arm, poses_of(q))]
    if not len(seen):
        none = f"{len(q)} poses keep clear, 0 of these show the board to the camera"
        raise LrmError(f"{none}; move the camera, or turn the board on the tool")
    return seen
