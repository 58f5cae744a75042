"""Commands that find what is missing: effects, diagnose, add, undo, auto."""

from __future__ import annotations

from functools import partial
from itertools import count
from typing import Annotated

import numpy as np
from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.common import app, error_of, log, nominal_error, progress, publish, read_identifiable, show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import load_poses
from lrm_ident.diagnosis.add_effect import AutoStep, add_effects, run_auto
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnose import diagnose as run_diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.diagnosis.inject_recover import InjectionPlan, detectable_effects, run_trials
from lrm_ident.diagnosis.nested_cross_validation import nested_held_out
from lrm_ident.effect_plugins import catalogue_with
from lrm_ident.estimation.error_breakdown import HeldOutResidual, try_held_out
from lrm_ident.estimation.model_history import model_file, model_text, undo_step
from lrm_ident.plots.diagnosis import draw_report
from lrm_ident.report.diagnosis import (
    course_document,
    diagnosis_document,
    effect_blocks,
    selftest_document,
    step_blocks,
    step_document,
)
from lrm_ident.report.fit import ErrorSummary
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError, UnknownName
from lrm_math.model.model_file import ModelFile
from lrm_math.toml_file import read_toml


@app.command()
def effects(
    name: Annotated[str | None, Argument(metavar="ID", help="One effect; all of them if not given.")] = None,
    effects_file: arg.EffectsFile = None,
) -> None:
    """Explain the effects that the tool knows: cause, formula, parameters, what data it takes to see them."""
    catalogue = catalogue_with(effects_file)
    chosen = [kind for kind in catalogue if name in (None, kind.id)]
    if not chosen:
        raise UnknownName("effect", str(name), [kind.id for kind in catalogue])
    for kind in chosen:
        show(*effect_blocks(kind, in_full=name is not None))


@app.command()
def diagnose(
    model: arg.ModelPath,
    data: arg.DataFile,
    json: arg.JsonFile = None,
    figure: arg.FigureFile = None,
    effects_file: arg.EffectsFile = None,
) -> None:
    """Find out which physical effect a model misses, that none is missing, or that no known one explains it."""
    _, the_model, measured, catalogue = read_identifiable(model, data, effects_file)
    with progress("trying every effect at every place") as tick:
        found = run_diagnose(the_model, measured, catalogue, tick)
    with log.status("cross-validating") as status:
        report = build_report(found, status.update)
    publish(diagnosis_document(report), json, figure, partial(draw_report, report))


@app.command()
def add(
    model: arg.ModelPath,
    data: arg.DataFile,
    effect: Annotated[str, Argument(metavar="EFFECT[@PLACE]", help="For instance backlash@joint2.")],
    output: arg.NewModel,
    json: arg.JsonFile = None,
    effects_file: arg.EffectsFile = None,
) -> None:
    """Add an effect, refit everything, print the error before and after, and append the step to the model's history."""
    file, before, measured, catalogue = read_identifiable(model, data, effects_file)
    fitted = add_effects(before, measured, effects_at(before.arm, effect, catalogue))
    with progress("held-out error, before") as tick:
        left_before = try_held_out(before, measured, progress=tick)
    with progress("held-out error, after") as tick:
        left_after = try_held_out(fitted.model, measured, progress=tick)
    nominal = nominal_error(before.arm, measured)
    errors_before = ErrorSummary(nominal, error_of(before, measured), left_before)
    errors_after = ErrorSummary(nominal, error_stats(fitted.residual), left_after)
    publish(step_document(effect, len(before.free), errors_before, fitted, errors_after), json)
    step = model_file(fitted, measured, left_after, file.arm, f"add {effect}", "squared", file.history)
    write_text(output, model_text(step))
    show(f"Model written to {output}")


@app.command()
def undo(model: arg.ModelPath, output: arg.NewModel) -> None:
    """Take the last step of a model's history back, exactly."""
    restored = undo_step(read_toml(model, ModelFile))
    write_text(output, model_text(restored))
    show(f"Back before the last step; model written to {output}")


@app.command()
def auto(
    model: arg.ModelPath,
    data: arg.DataFile,
    output: arg.NewModel,
    max_effects: Annotated[int, Option(min=0, help="Stop after this many.")] = 20,
    nested: Annotated[
        bool, Option("--nested/--no-nested", help="Also choose the effects anew in every fold: honest, but longer.")
    ] = True,
    json: arg.JsonFile = None,
    effects_file: arg.EffectsFile = None,
) -> None:
    """Follow the tool's own advice, effect by effect, until it says stop."""
    file, the_model, measured, catalogue = read_identifiable(model, data, effects_file)
    numbers = count()

    def on_step(step: AutoStep, found: Diagnosis) -> None:
        show(*step_blocks(next(numbers), step, float(np.sqrt(found.squared_held_out.mean()))))

    course = run_auto(the_model, measured, max_effects, catalogue, on_step)
    final, held_out = file, None
    for step in course.steps[1:]:
        with progress(f"held-out error with {step.added}") as tick:
            held_out = try_held_out(step.fit.model, measured, progress=tick)
        final = model_file(step.fit, measured, held_out, file.arm, f"add {step.added}", "squared", final.history)
    fitted = course.steps[-1].fit
    held_out = held_out or try_held_out(fitted.model, measured)
    write_text(output, model_text(final))
    title = f"{len(course.steps) - 1} effects added (held out: effects chosen on all poses)"
    errors = ErrorSummary(nominal_error(the_model.arm, measured), error_stats(fitted.residual), held_out)
    show(f"Model written to {output}", *errors.blocks(title))
    whole = HeldOutResidual(None, "not asked for (--no-nested)")
    if nested:
        with progress("choosing anew in every fold") as tick:
            whole = nested_held_out(the_model, measured, max_effects, catalogue, effects_file, tick)
    publish(course_document(course, build_report(course.diagnosis), held_out, whole), json)


@app.command()
def selftest(
    arm: arg.ArmArgument,
    poses: arg.PosesFile,
    only: Annotated[str, Option(help="Only effects that match, for instance 'backlash@*'.")] = "*",
    noise_mm: arg.NoiseMm = 0.3,
    seed: Annotated[int, Option(help="Of the arm's errors and the noise.")] = 0,
    json: arg.JsonFile = None,
    effects_file: arg.EffectsFile = None,
) -> None:
    """Tell before measuring whether a plan of poses can find what you look for.

    Injects each effect at its typical size into an arm with random errors, at your poses; prints what would be named.
    """
    plan = InjectionPlan(arm, load_poses(poses, load_arm(arm)), noise_mm * MM, seed, effects_file)
    names, refused = detectable_effects(plan, only)
    if not names:
        raise LrmError(f"no effect that these poses can show matches '{only}'")
    with progress(f"injecting {len(names)} effects") as tick:
        trials = sorted(run_trials(plan, names, tick), key=lambda trial: names.index(trial.truth))
    publish(selftest_document(len(plan.poses), trials, refused), json)
