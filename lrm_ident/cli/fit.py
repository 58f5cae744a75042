"""Commands that fit, predict and compare, take a step back, and explain effects: those that diagnose nothing."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import (
    bars,
    check_arm,
    leave_out_poses,
    notice,
    opened,
    publish,
    read_measurements,
    read_model,
    read_poses,
    show,
)
from lrm_ident.data.atomic_write import write_bytes, write_text
from lrm_ident.data.measurement_file.conventions import arm_for, metadata_of
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.effect_plugins import Catalogue, catalogue_with
from lrm_ident.fitting.loss import loss_named
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS, nominal_model
from lrm_ident.fitting.priors import Prior
from lrm_ident.report.document import Document, ResultTable
from lrm_ident.report.effects import effect_blocks, listed
from lrm_ident.report.fit import comparison_document, diagnose_next, fit_document
from lrm_ident.report.plots.comparison import draw_comparison
from lrm_ident.report.priors import PriorComparison
from lrm_ident.report.text.notices import fit_words
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.study.inputs import arm_from
from lrm_ident.study.model_history import check_replaces, undo_step, write_model
from lrm_ident.study.other_data import model_for_data
from lrm_ident.study.study import Study
from lrm_math.arm.arm import Arm
from lrm_math.effects import FIELDS, FREE_FORMS, OWN_EFFECT
from lrm_math.errors import LrmError, UnknownName
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.toml_file import read_toml


@command
def fit(
    data: arg.DataFile,
    arm: arg.ArmName = None,
    effects: Annotated[
        str | None,
        Option(
            help="Effects of the model, by commas: offsets, compliance, lateral_compliance, backlash@joint2, … "
            "Default: offsets,compliance."
        ),
    ] = None,
    start: Annotated[
        Path | None,
        Option(
            metavar="MODEL", help="Start from the values of this model, and from its effects unless --effects is given."
        ),
    ] = None,
    parameters: Annotated[
        str,
        Option(
            help="Parameters to fit: 'identifiable' (all, with typical sizes as prior), option1 to option5 of the "
            "thesis, or names and patterns by commas, for instance 'compliance.*,offsets.base.?_mm'."
        ),
    ] = "identifiable",
    loss: Annotated[
        str, Option(help="squared, huber or cauchy. The last two limit the influence of wrong measurements.")
    ] = "squared",
    leave_out: Annotated[
        str,
        Option(metavar="POSES", help="Numbers of poses to leave out, for instance 12,40-42; the model remembers them."),
    ] = "",
    unbounded: Annotated[
        bool, Option("--unbounded", help="Allow what physics forbids, such as negative compliances.")
    ] = False,
    prior: Annotated[
        str | None,
        Option(
            help="What is known before the fit: a shipped prior (printed, vague) or a prior file. Default: typical "
            "sizes of the parameters."
        ),
    ] = None,
    output: Annotated[Path | None, Option("-o", "--output", metavar="MODEL", help="Where to write the model.")] = None,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
    force: arg.Force = False,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Fit the model of an arm to measurements: DATA -> MODEL.

    Prints the error before and after, at poses that the fit did not see, and as deployed. With --all also every
    parameter with its standard error, and how much of it the poses determine.
    """
    if output is not None and not force:
        check_replaces(output, 1)
    arm_name, the_arm = arm_for(data, arm)
    measured = read_measurements(data, the_arm, arm_name, reading, part=lambda every: leave_out_poses(every, leave_out))
    model = _start_model(measured, the_arm, effects, start, catalogue := catalogue_with(effects_file))
    with bars() as progress:
        begun = Study(model, measured, arm_name, catalogue, progress=progress)
        fitted = begun.fit(parameters, loss_named(loss), prior, unbounded)
        notice(*fitted.notices)
        step = fitted.taken
        document = fit_document(step.fit, fitted.errors, measured)
        if step.stated_prior:
            beside = _beside_default(begun, fitted, step.stated_prior, parameters, unbounded)
            blocks, values = [*document.blocks, *beside.blocks()], {**document.values, "prior": beside}
            document = replace(document, blocks=blocks, values=values)
    if output:
        fitted.save(output)
    publish(document, json, in_full=show_all)
    show("Not saved; give -o MODEL to keep it." if output is None else f"Model written to {output}")
    if output is not None:
        show(*diagnose_next([str(output), str(data)]))


@command
def predict(
    model: arg.ModelPath,
    poses: arg.PosesFile,
    output: Annotated[Path, Option("-o", "--output", metavar="CSV", help="Where to write the predictions.")],
    json: arg.JsonFile = None,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Predict the TCP (mm) and gravity's joint torques (Nm) at commanded poses, in the frame of the arm file."""
    file, the_model = read_model(model, catalogue_with(effects_file))
    how = reading.over(metadata_of(poses)).over(None if file.provenance is None else file.provenance.reading)
    if how.joint_sign or how.joint_order or how.angle_unit:
        notice(
            f"{poses.name}: angles read as the options, the file beside it or the model's fit say; "
            "those written are the arm file's own, in deg"
        )
    asked = read_poses(poses, the_model.arm, how)
    here, left_out = model_for_data(the_model, poses, asked.sha256 or "", asked)
    notice(*left_out)
    settled = solve_equilibrium(here, asked)
    table = _predictions(settled)
    within, q = the_model.within, settled.poses.q
    if within is not None and (said := within.sentence(q)):
        notice(said)
    beyond = [] if within is None else (np.flatnonzero(within.outside(q).any(axis=1)) + 1).tolist()
    publish(Document([], "lrm/prediction/1", {"poses": table.records(), "outside_range": beyond}), json)
    write_text(output, table.csv())
    show(f"{len(settled.tcp)} predictions written to {output}")


@command
def compare(
    model: arg.ModelPath,
    data: arg.DataFile,
    json: arg.JsonFile = None,
    figure: arg.FigureFile = None,
    mcap: Annotated[
        Path | None,
        Option("--mcap", metavar="FILE", help="Also write the arm and the error arrows of each pose, for Foxglove."),
    ] = None,
    show_all: arg.ShowAll = False,
    left_out: Annotated[bool, Option("--left-out", help="Only the poses that the model's fit left out.")] = False,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Show where a model fails on measurements: by joint angle, torque, load, order or region.

    The held-out error comes from ten folds of neighbouring poses, each predicted by a fit to the others. With --all
    also groups of poses and the worst poses.
    """
    part = Measurements.only if left_out else Measurements.without
    with opened(model, data, effects_file, reading, part) as study:
        provenance = study.file.provenance
        if provenance and provenance.data_sha256 != study.data.source.sha256:
            notice(f"the model was fitted to {provenance.data}; its error here is on poses it never saw")
        comparison = study.compare()
    if mcap is not None:
        from lrm_ident.report.model_report import models_on_data
        from lrm_ident.report.plots.comparison_scene import scene_file

        write_bytes(mcap, scene_file(comparison, models_on_data(study)))
    files = str(model), str(data)
    publish(comparison_document(comparison, files), json, figure, partial(draw_comparison, comparison), show_all)


@command
def undo(model: arg.ModelPath, output: arg.NewModel) -> None:
    """Undo the last step of a model: the model file before it, with the same numbers."""
    restored = undo_step(read_toml(model, ModelFile))
    write_model(output, restored, arm_from(model, restored.arm))
    provenance = restored.provenance
    how = "" if provenance is None else fit_words(provenance.loss, provenance.left_out)
    show(f"Undone: the last step{how and f' ({how})'}; model written to {output}")


@command
def effects(
    name: Annotated[str | None, Argument(metavar="ID", help="One effect; all of them if not given.")] = None,
    show_all: arg.ShowAll = False,
    effects_file: arg.EffectsFile = None,
) -> None:
    """Explain the effects of the catalogue: cause, formula, parameters, and the measurements that show them."""
    catalogue = (*catalogue_with(effects_file), *FREE_FORMS, *FIELDS)
    chosen = [kind for kind in catalogue if name in (None, kind.id)]
    if not chosen:
        raise UnknownName("effect", str(name), [kind.id for kind in catalogue], OWN_EFFECT)
    if name is None and not show_all:
        causes = [kind.id for kind in chosen if not kind.variant_of and kind.names_a_cause]
        others = [kind.id for kind in chosen if kind.id not in causes]
        show(*listed("lrm-ident effects ID", "Physical effects", causes))
        show(*listed("the same command", "Empirical terms", others))
        return
    for kind in chosen:
        show(*effect_blocks(kind, in_full=name is not None))


def _beside_default(begun: Study, fitted: Study, prior: Prior, parameters: str, unbounded: bool) -> PriorComparison:
    """The fit beside one with typical sizes, or beside the reason why there is none."""
    comparison = PriorComparison(prior, fitted.taken.fit, fitted.held_out, "", HeldOutResidual(None))
    try:
        default = begun.fit(parameters, fitted.loss, unbounded=unbounded)
    except LrmError as error:
        return replace(comparison, default=str(error), default_held_out=HeldOutResidual(None, str(error)))
    return replace(comparison, default=default.taken.fit, default_held_out=default.held_out)


def _start_model(data: Measurements, arm: Arm, effects: str | None, start: Path | None, catalogue: Catalogue) -> Model:
    loaded = read_model(start, catalogue)[1] if start else None
    if start and loaded:
        check_arm(start, loaded.arm, arm)
        loaded, left_out = model_for_data(loaded, data.source.path, data.source.sha256)
        notice(*left_out)
    if effects is None and loaded:
        return loaded
    names = DEFAULT_EFFECTS if effects is None else [name.strip() for name in effects.split(",")]
    model = nominal_model(arm, names, catalogue)
    if loaded is None:
        return model
    values = {key: loaded.value(key) for key in loaded.keys if key in model.keys}
    return model_of(arm, model.effects, values)


def _predictions(settled: Equilibrium) -> ResultTable:
    q, n = np.degrees(settled.poses.q), settled.model.arm.dof
    columns = [*(f"q{i + 1}_deg|.6f" for i in range(n)), "payload_g|.3f", "x_mm|.7f", "y_mm|.7f", "z_mm|.7f"]
    columns += ["tau_base_Nm|.10f", *(f"tau{i + 1}_Nm|.10f" for i in range(n))]
    payload, base = settled.poses.payload[:, None] * 1e3, settled.base_moment[:, None]
    return ResultTable(
        columns, np.concatenate([q, payload, settled.tcp * 1e3, base, settled.joint_torque], axis=1).tolist()
    )
