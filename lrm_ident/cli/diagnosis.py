"""Commands that find what is missing: effects, diagnose, add, undo, auto."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from lrm_ident.cli.arguments import (
    DataFile,
    EffectName,
    EffectsFile,
    FigureFile,
    JsonFile,
    ModelPath,
    MostEffects,
    NewModel,
    PosesFile,
)
from lrm_ident.cli.common import app, log, out, progress, read_measurements, read_model, told_by_data
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.error_stats import figures
from lrm_ident.data.measurements import load_poses
from lrm_ident.diagnosis.add_effect import Step, add_effects, follow_advice
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnose import diagnose as run_diagnose
from lrm_ident.diagnosis.diagnosis_report import advise
from lrm_ident.diagnosis.inject_recover import Plan, may_show, run
from lrm_ident.diagnosis.nested_cross_validation import nested_held_out
from lrm_ident.effect_plugins import catalogue_with
from lrm_ident.fit.error_breakdown import HeldOut, try_held_out
from lrm_ident.fit.model_history import model_file, model_text, undone
from lrm_ident.report import json_files
from lrm_ident.report.diagnosis import print_effect, print_report, print_step, print_trials
from lrm_ident.report.fit import error_table, parameter_table
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError, UnknownName
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.model_file import ModelFile
from lrm_math.toml_file import read_toml


@app.command()
def effects(
    name: Annotated[str | None, typer.Argument(metavar="ID", help="One effect; all of them if not given.")] = None,
    effects_file: EffectsFile = None,
) -> None:
    """Explain the effects that the tool knows: cause, formula, parameters, what data it takes to see them."""
    catalogue = catalogue_with(effects_file)
    chosen = [kind for kind in catalogue if name in (None, kind.id)]
    if not chosen:
        raise UnknownName("effect", str(name), [kind.id for kind in catalogue])
    for kind in chosen:
        print_effect(out, kind, in_full=name is not None)


@app.command()
def diagnose(
    model: ModelPath,
    data: DataFile,
    json: JsonFile = None,
    figure: FigureFile = None,
    effects_file: EffectsFile = None,
) -> None:
    """Find out which physical effect a model misses, that none is missing, or that no known one explains it."""
    file, the_model = read_model(model, catalogue := catalogue_with(effects_file))
    measured = read_measurements(data, the_model.arm, file.arm)
    the_model = told_by_data(file, the_model, measured)
    with progress("trying every effect at every place") as tick:
        found = run_diagnose(the_model, measured, catalogue, tick)
    with log.status("cross-validating") as status:
        report = advise(found, status.update)
    print_report(out, report)
    if json:
        write_text(json, json_files.text(json_files.diagnosis_json(report)))
    if figure:
        from lrm_ident.plots.diagnosis import draw_report  # matplotlib takes half a second to load

        draw_report(report, figure)
        out.print(f"Figure written to {figure}")


@app.command()
def add(
    model: ModelPath,
    data: DataFile,
    effect: EffectName,
    output: NewModel,
    json: JsonFile = None,
    effects_file: EffectsFile = None,
) -> None:
    """Add an effect, refit everything, print the error before and after, and append the step to the model's history."""
    file, before = read_model(model, catalogue := catalogue_with(effects_file))
    measured = read_measurements(data, before.arm, file.arm)
    before = told_by_data(file, before, measured)
    fitted = add_effects(before, measured, effects_at(before.arm, effect, catalogue))
    with progress("held-out error, before") as tick:
        left_before = try_held_out(before, measured, progress=tick)
    with progress("held-out error, after") as tick:
        left_after = try_held_out(fitted.model, measured, progress=tick)
    nominal = figures(measured.tcp - equilibrium(model_of(before.arm, ()), measured.poses).tcp)
    was = figures(measured.tcp - equilibrium(before, measured.poses).tcp)
    out.print(parameter_table(fitted))
    out.print(error_table(nominal, was, left_before, f"before: {len(before.free)} parameters"))
    out.print(error_table(nominal, figures(fitted.residual), left_after, f"with {effect}: {len(fitted.model.free)}"))
    if json:
        tables = {"schema": "lrm/step/1", "added": effect, "parameters": len(fitted.model.free)}
        errors = json_files.before_and_after(was, left_before, figures(fitted.residual), left_after)
        write_text(json, json_files.text(tables | errors))
    step = model_file(fitted, measured, left_after, file.arm, f"add {effect}", "squared", file.history)
    write_text(output, model_text(step))
    out.print(f"Model written to {output}")


@app.command()
def undo(model: ModelPath, output: NewModel) -> None:
    """Take the last step of a model's history back, exactly."""
    restored = undone(read_toml(model, ModelFile))
    write_text(output, model_text(restored))
    out.print(f"Back before the last step; model written to {output}")


@app.command()
def auto(
    model: ModelPath,
    data: DataFile,
    output: NewModel,
    max_effects: MostEffects = 20,
    nested: Annotated[
        bool,
        typer.Option("--nested/--no-nested", help="Also choose the effects anew in every fold: honest, but longer."),
    ] = True,
    json: JsonFile = None,
    effects_file: EffectsFile = None,
) -> None:
    """Follow the tool's own advice, effect by effect, until it says stop."""
    file, the_model = read_model(model, catalogue := catalogue_with(effects_file))
    measured = read_measurements(data, the_model.arm, file.arm)
    the_model = told_by_data(file, the_model, measured)
    numbers = iter(range(max_effects + 2))

    def told(step: Step, found: Diagnosis) -> None:
        left = float(np.sqrt(found.before.mean()))
        print_step(out, next(numbers), step, left)

    course = follow_advice(the_model, measured, max_effects, catalogue, told)
    history = list(file.history)
    for step in course.steps[1:]:
        with progress(f"held-out error with {step.added}") as tick:
            left_out = try_held_out(step.fit.model, measured, progress=tick)
        history = model_file(step.fit, measured, left_out, file.arm, f"add {step.added}", "squared", history).history
    last = course.steps[-1].fit
    left_out = try_held_out(last.model, measured)
    done = file
    if len(course.steps) > 1:
        done = model_file(last, measured, left_out, file.arm, f"add {course.steps[-1].added}", "squared", history[:-1])
    write_text(output, model_text(done))
    out.print(f"Model written to {output}")
    nominal = figures(measured.tcp - equilibrium(model_of(the_model.arm, ()), measured.poses).tcp)
    title = f"{len(course.steps) - 1} effects added (held out: effects chosen on all poses)"
    out.print(error_table(nominal, figures(last.residual), left_out, title))
    whole = HeldOut(None, "not asked for (--no-nested)")
    if nested:
        with progress("choosing anew in every fold") as tick:
            whole = nested_held_out(the_model, measured, max_effects, catalogue, effects_file, tick)
    if whole.error is None:
        out.print(f"Held out, effects chosen anew in every fold (nested): none, because {whole.reason}")
    else:
        mean, rms = whole.error.mean * 1e3, whole.error.rms * 1e3
        out.print(
            f"Held out, effects chosen anew in every fold (nested): mean {mean:.2f}, RMS {rms:.2f} mm", style="bold"
        )
    print_report(out, advise(course.last))
    if json:
        write_text(json, json_files.text(json_files.course_json(course, left_out, whole)))


@app.command()
def selftest(
    arm: Annotated[str, typer.Argument(metavar="ARM", help="A shipped arm or the path of an arm file.")],
    poses: PosesFile,
    only: Annotated[str, typer.Option(help="Only effects that match, for instance 'backlash@*'.")] = "*",
    noise_mm: Annotated[float, typer.Option(min=0.001, help="Noise of the measurement per axis.")] = 0.3,
    seed: Annotated[int, typer.Option(help="Of the arm's errors and the noise.")] = 0,
    json: JsonFile = None,
    effects_file: EffectsFile = None,
) -> None:
    """Tell before measuring whether a plan of poses can find what you look for.

    Injects each effect at its typical size into an arm with random errors, at your poses; prints what would be named.
    """
    plan = Plan(arm, load_poses(poses, load_arm(arm)), noise_mm * 1e-3, seed, effects_file)
    names, refused = may_show(plan, only)
    if not names:
        raise LrmError(f"no effect that these poses can show matches '{only}'")
    with progress(f"injecting {len(names)} effects") as tick:
        trials = sorted(run(plan, names, tick), key=lambda trial: names.index(trial.truth))
    print_trials(out, trials, refused)
    if json:
        rows = [json_files.trial(trial) for trial in trials]
        write_text(json, json_files.text({"schema": "lrm/selftest/1", "poses": len(plan.poses), "trials": rows}))
