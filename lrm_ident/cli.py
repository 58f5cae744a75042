"""`lrm-ident`: the commands. Each reads, calls pure functions, prints, and writes its files last."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import typer
from rich.console import Console
from rich.progress import Progress

from lrm_ident import as_json
from lrm_ident.cli_arguments import (
    ArmName,
    DataFile,
    Effects,
    FigureFile,
    JsonFile,
    LossName,
    ModelOutput,
    ModelPath,
    Parameters,
    PosesFile,
    Start,
    TableOutput,
    Unbounded,
)
from lrm_ident.compare import compare as run_compare
from lrm_ident.compare import try_held_out
from lrm_ident.dataset import Measurements, load_measurements, load_poses, metadata_of
from lrm_ident.figures_of_merit import figures
from lrm_ident.fit import bounds_of, no_bounds
from lrm_ident.fit import fit as run_fit
from lrm_ident.history import arm_name_for, model_file, model_text
from lrm_ident.identifiability import IdentifiedFit, fit_identifiable
from lrm_ident.loss import Loss, loss_named
from lrm_ident.options import chosen
from lrm_ident.progress import Tick
from lrm_ident.show import print_comparison, print_fit
from lrm_ident.table_file import Array, table_text
from lrm_ident.write import write_text
from lrm_math.arm import Arm
from lrm_math.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, LrmError
from lrm_math.model import Model, equilibrium, model_of
from lrm_math.model_file import ModelFile, load_model
from lrm_math.poses import Poses
from lrm_math.toml_file import read_toml

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Identify the model of a robot arm from measured TCP positions, and see where it fails.\n\n"
    "Start with: lrm-ident fit DATA.csv --arm lrm-lab -o model.toml, then lrm-ident compare model.toml DATA.csv",
)
out = Console(width=None if sys.stdout.isatty() else 100)
log = Console(stderr=True)


@app.command()
def fit(
    data: DataFile,
    arm: ArmName = None,
    effects: Effects = None,
    start: Start = None,
    parameters: Parameters = "identifiable",
    loss: LossName = "squared",
    unbounded: Unbounded = False,
    output: ModelOutput = None,
    json: JsonFile = None,
) -> None:
    """Fit the model of an arm to measurements: DATA -> MODEL.

    Prints every parameter with its standard error, what the data cannot tell, and the error before, after, and on
    poses that the fit did not see.
    """
    arm_name, the_arm = _arm_for(data, arm)
    measured = _measurements(data, the_arm)
    model = _start_model(the_arm, effects, start)
    how = loss_named(loss)
    result = _fit(model, measured, parameters, how, unbounded)
    fitted = result.fit.model
    limits = no_bounds(fitted.free) if unbounded else bounds_of(fitted, fitted.free)
    with _progress("held-out error") as tick:
        held_out = try_held_out(fitted, measured, limits, how, tick)
    nominal = figures(measured.tcp - equilibrium(model_of(the_arm, ()), measured.poses).tcp)
    print_fit(out, result.fit, result.held, nominal, held_out, measured)
    if json:
        write_text(json, as_json.text(as_json.fit_json(result.fit, result.held, nominal, held_out, measured)))
    if output:
        name = arm_name_for(arm_name, output.parent)
        write_text(output, model_text(model_file(result.fit, measured, held_out, name, "fit", how.name)))
        out.print(f"Model written to {output}")
    else:
        out.print("Not saved; give -o MODEL to keep it.")


@app.command()
def predict(model: ModelPath, poses: PosesFile, output: TableOutput, json: JsonFile = None) -> None:
    """Predict the TCP (mm) and gravity's joint torques (Nm) at commanded poses."""
    the_model = load_model(model)
    asked = load_poses(poses, the_model.arm)
    rest = equilibrium(the_model, asked)
    columns = _prediction(asked, rest.tcp, rest.joint_torque, rest.base_moment)
    if json:
        names = [name for name, _, _ in columns]
        cells = np.stack([values for _, values, _ in columns], axis=1).tolist()
        rows = [dict(zip(names, row, strict=True)) for row in cells]
        write_text(json, as_json.text({"schema": "lrm/prediction/1", "poses": rows}))
    write_text(output, table_text(columns))
    out.print(f"{len(asked)} predictions written to {output}")


@app.command()
def compare(model: ModelPath, data: DataFile, json: JsonFile = None, figure: FigureFile = None) -> None:
    """Show where a model fails on measurements: by joint angle, torque, load, order, region; the worst poses.

    The held-out error comes from refitting the model's parameters in ten folds of neighbouring poses.
    """
    the_model = load_model(model)
    measured = _measurements(data, the_model.arm)
    _warn_of_other_arm(data, read_toml(model, ModelFile).arm)
    with _progress("held-out error") as tick:
        comparison = run_compare(the_model, measured, tick)
    print_comparison(out, comparison, measured)
    if json:
        write_text(json, as_json.text(as_json.comparison_json(comparison, measured)))
    if figure:
        from lrm_ident.draw import draw_comparison  # matplotlib takes half a second to load

        draw_comparison(comparison, measured, figure)
        out.print(f"Figure written to {figure}")


def _fit(model: Model, data: Measurements, parameters: str, loss: Loss, unbounded: bool) -> IdentifiedFit:
    if parameters == "identifiable":
        keys = tuple(key for key, p in zip(model.keys, model.parameters, strict=True) if p.fixed is None)
        return fit_identifiable(model, data, keys, loss, no_bounds(keys) if unbounded else None)
    free = replace(model, free=chosen(model, parameters))
    return IdentifiedFit(run_fit(free, data, no_bounds(free.free) if unbounded else None, loss), ())


def _start_model(arm: Arm, effects: str | None, start: Path | None) -> Model:
    begun = load_model(start) if start else None
    if begun and begun.arm != arm:
        raise FileError(str(start), "arm", f"is a model of {begun.arm.name}, the data are of {arm.name}")
    if effects is None and begun:
        return begun
    names = [name.strip() for name in (effects or "offsets,compliance").split(",")]
    model = model_of(arm, [effect for name in names for effect in effects_at(arm, name)])
    if begun is None:
        return model
    known = {key: begun.value(key) for key in begun.keys if key in model.keys}
    return model_of(arm, model.effects, known)


def _arm_for(data: Path, arm: str | None) -> tuple[str, Arm]:
    if arm is not None:
        _warn_of_other_arm(data, arm)
        return arm, load_arm(arm)
    metadata = metadata_of(data) if data.exists() else None
    if not data.exists():
        raise FileError(data, "", "no such file")
    if metadata is None or metadata.arm is None:
        raise FileError(data, "", "no arm given", "name it with --arm, or as arm in the .toml file beside the data")
    return metadata.arm, load_arm(metadata.arm)


def _warn_of_other_arm(data: Path, arm: str) -> None:
    metadata = metadata_of(data) if data.exists() else None
    if metadata and metadata.arm and metadata.arm != arm:
        log.print(f"notice: {data.name} was measured on {metadata.arm}, the model is of {arm}")


def _measurements(path: Path, arm: Arm) -> Measurements:
    data = load_measurements(path, arm)
    for notice in data.notices:
        log.print(f"notice: {path.name}: {notice}")
    return data


def _prediction(poses: Poses, tcp: Array, torque: Array, base_moment: Array) -> list[tuple[str, Array, int]]:
    n = poses.q.shape[1]
    return [
        *((f"q{i + 1}_deg", np.degrees(poses.q[:, i]), 6) for i in range(n)),
        ("payload_g", poses.payload * 1e3, 3),
        *((f"{axis}_mm", tcp[:, i] * 1e3, 7) for i, axis in enumerate("xyz")),
        ("tau_base_Nm", base_moment, 10),
        *((f"tau{i + 1}_Nm", torque[:, i], 10) for i in range(n)),
    ]


@contextmanager
def _progress(what: str) -> Iterator[Tick]:
    with Progress(console=log, transient=True, disable=not log.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)


def main() -> None:
    """Entry point: every expected error is one line on stderr and exit code 2."""
    try:
        app()
    except LrmError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
