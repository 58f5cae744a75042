"""Commands that fit, predict and compare. Each reads, calls pure functions, prints, and writes its files last."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.cli.arguments import (
    ArmName,
    DataFile,
    Effects,
    EffectsFile,
    FigureFile,
    JsonFile,
    LossName,
    ModelOutput,
    ModelPath,
    Parameters,
    PosesFile,
    PriorName,
    Start,
    TableOutput,
    Unbounded,
)
from lrm_ident.cli.common import app, arm_for, out, progress, read_measurements, read_model
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.csv_table import table_text
from lrm_ident.data.error_stats import figures
from lrm_ident.data.measurements import Measurements, load_poses
from lrm_ident.effect_plugins import Catalogue, catalogue_with
from lrm_ident.fit.error_breakdown import HeldOut, try_held_out
from lrm_ident.fit.error_breakdown import compare as run_compare
from lrm_ident.fit.identifiability import IdentifiedFit, fit_identifiable
from lrm_ident.fit.levenberg_marquardt import Bounds, Fit, bounds_of, no_bounds
from lrm_ident.fit.levenberg_marquardt import fit as run_fit
from lrm_ident.fit.loss import Loss, loss_named
from lrm_ident.fit.model_history import arm_name_for, model_file, model_text
from lrm_ident.fit.parameter_sets import chosen
from lrm_ident.fit.priors import Prior, load_prior, prior_behind, prior_name_for
from lrm_ident.progress import Tick
from lrm_ident.report import json_files
from lrm_ident.report.fit import print_comparison, print_fit
from lrm_ident.report.priors import Elimination, print_beside_elimination
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model, model_of


@app.command()
def fit(
    data: DataFile,
    arm: ArmName = None,
    effects: Effects = None,
    start: Start = None,
    parameters: Parameters = "identifiable",
    loss: LossName = "squared",
    unbounded: Unbounded = False,
    prior: PriorName = None,
    output: ModelOutput = None,
    json: JsonFile = None,
    effects_file: EffectsFile = None,
) -> None:
    """Fit the model of an arm to measurements: DATA -> MODEL.

    Prints every parameter with its standard error, what the data cannot tell, and the error before, after, and on
    poses that the fit did not see. With --prior: the same for all parameters at once (maximum a posteriori).
    """
    arm_name, the_arm = arm_for(data, arm)
    measured = read_measurements(data, the_arm, arm_name)
    model = _start_model(the_arm, effects, start, catalogue := catalogue_with(effects_file))
    how, known = loss_named(loss), None if prior is None else load_prior(prior, model, catalogue)
    result = _fit(model, measured, parameters, how, unbounded, known)
    fitted = result.fit.model
    with progress("held-out error") as tick:
        held_out = try_held_out(fitted, measured, _limits(fitted, unbounded), how, tick, known)
    nominal = figures(measured.tcp - equilibrium(model_of(the_arm, ()), measured.poses).tcp)
    print_fit(out, result.fit, result.held, nominal, held_out, measured)
    tables = json_files.fit_json(result.fit, result.held, nominal, held_out, measured)
    if known:
        with progress("held-out error without the prior") as tick:
            beside = Elimination(
                known, result.fit, held_out, *_alone(model, measured, parameters, how, unbounded, tick)
            )
        print_beside_elimination(out, beside)
        tables["prior"] = beside.as_json()
    if json:
        write_text(json, json_files.text(tables))
    if output:
        name = arm_name_for(arm_name, output.parent)
        where = None if prior is None else prior_name_for(prior)
        file = model_file(result.fit, measured, held_out, name, "fit", how.name, prior=where)
        write_text(output, model_text(file))
        out.print(f"Model written to {output}")
    else:
        out.print("Not saved; give -o MODEL to keep it.")


@app.command()
def predict(
    model: ModelPath, poses: PosesFile, output: TableOutput, json: JsonFile = None, effects_file: EffectsFile = None
) -> None:
    """Predict the TCP (mm) and gravity's joint torques (Nm) at commanded poses."""
    _, the_model = read_model(model, catalogue_with(effects_file))
    asked = load_poses(poses, the_model.arm)
    rest = equilibrium(the_model, asked)
    columns = _prediction(asked, rest.tcp, rest.joint_torque, rest.base_moment)
    if json:
        names = [name for name, _, _ in columns]
        cells = np.stack([values for _, values, _ in columns], axis=1).tolist()
        rows = [dict(zip(names, row, strict=True)) for row in cells]
        write_text(json, json_files.text({"schema": "lrm/prediction/1", "poses": rows}))
    write_text(output, table_text(columns))
    out.print(f"{len(asked)} predictions written to {output}")


@app.command()
def compare(
    model: ModelPath,
    data: DataFile,
    json: JsonFile = None,
    figure: FigureFile = None,
    effects_file: EffectsFile = None,
) -> None:
    """Show where a model fails on measurements: by joint angle, torque, load, order, region; the worst poses.

    The held-out error comes from refitting the model's parameters in ten folds of neighbouring poses.
    """
    file, the_model = read_model(model, catalogue := catalogue_with(effects_file))
    measured = read_measurements(data, the_model.arm, file.arm)
    prior = prior_behind(file, the_model, catalogue)
    with progress("held-out error") as tick:
        comparison = run_compare(the_model, measured, tick, prior)
    print_comparison(out, comparison, measured)
    if json:
        write_text(json, json_files.text(json_files.comparison_json(comparison, measured)))
    if figure:
        from lrm_ident.plots.comparison import draw_comparison  # matplotlib takes half a second to load

        draw_comparison(comparison, measured, figure)
        out.print(f"Figure written to {figure}")


def _fit(
    model: Model, data: Measurements, parameters: str, loss: Loss, unbounded: bool, prior: Prior | None = None
) -> IdentifiedFit:
    if parameters == "identifiable":
        keys = tuple(key for key, p in zip(model.keys, model.parameters, strict=True) if p.fixed is None)
        if prior is None:
            return fit_identifiable(model, data, keys, loss, no_bounds(keys) if unbounded else None)
    else:
        keys = chosen(model, parameters)
    free = replace(model, free=keys)
    return IdentifiedFit(run_fit(free, data, _limits(free, unbounded), loss, prior), ())


def _alone(
    model: Model, data: Measurements, parameters: str, loss: Loss, unbounded: bool, tick: Tick
) -> tuple[Fit | str, HeldOut]:
    """The fit without a prior and its held-out error, or the reason why there is none."""
    try:
        alone = _fit(model, data, parameters, loss, unbounded).fit
    except LrmError as error:
        return str(error), HeldOut(None, str(error))
    return alone, try_held_out(alone.model, data, _limits(alone.model, unbounded), loss, tick)


def _limits(model: Model, unbounded: bool) -> Bounds:
    return no_bounds(model.free) if unbounded else bounds_of(model, model.free)


def _start_model(arm: Arm, effects: str | None, start: Path | None, catalogue: Catalogue) -> Model:
    begun = read_model(start, catalogue)[1] if start else None
    if begun and begun.arm != arm:
        raise FileError(str(start), "arm", f"is a model of {begun.arm.name}, the data are of {arm.name}")
    if effects is None and begun:
        return begun
    names = [name.strip() for name in (effects or "offsets,compliance").split(",")]
    model = model_of(arm, [effect for name in names for effect in effects_at(arm, name, catalogue)])
    if begun is None:
        return model
    known = {key: begun.value(key) for key in begun.keys if key in model.keys}
    return model_of(arm, model.effects, known)


def _prediction(poses: Poses, tcp: Array, torque: Array, base_moment: Array) -> list[tuple[str, Array, int]]:
    n = poses.q.shape[1]
    return [
        *((f"q{i + 1}_deg", np.degrees(poses.q[:, i]), 6) for i in range(n)),
        ("payload_g", poses.payload * 1e3, 3),
        *((f"{axis}_mm", tcp[:, i] * 1e3, 7) for i, axis in enumerate("xyz")),
        ("tau_base_Nm", base_moment, 10),
        *((f"tau{i + 1}_Nm", torque[:, i], 10) for i in range(n)),
    ]
