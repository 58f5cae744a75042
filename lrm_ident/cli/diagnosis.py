"""Commands that find what is missing: effects, diagnose, add, undo, auto."""

from __future__ import annotations

from functools import partial
from itertools import count
from typing import Annotated

from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import (
    LISTED,
    log,
    named_progress,
    notice,
    progress,
    publish,
    read_identifiable,
    show,
)
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.diagnosis.auto import AutoStep, run_auto
from lrm_ident.diagnosis.diagnose import diagnose as run_diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report, report_of
from lrm_ident.diagnosis.inject_recover import InjectionPlan, detectable_effects, run_trials
from lrm_ident.diagnosis.nested_cross_validation import nested_held_out
from lrm_ident.effect_plugins import catalogue_with
from lrm_ident.estimation.cross_validation import FOLDS
from lrm_ident.estimation.error_breakdown import HeldOutResidual
from lrm_ident.estimation.model_history import model_text, undo_step
from lrm_ident.estimation.priors import load_rates
from lrm_ident.executors import executor_for
from lrm_ident.plots.diagnosis import draw_report
from lrm_ident.report.diagnosis import (
    course_document,
    diagnosis_document,
    effect_blocks,
    selftest_document,
    step_blocks,
)
from lrm_ident.report.fit import ErrorSummary, fit_words
from lrm_ident.workflow.steps import add_step, auto_files, nominal_error, prior_step
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.effects import FREE_FORMS, effects_at
from lrm_math.errors import LrmError, UnknownName
from lrm_math.model.model_file import ModelFile
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.toml_file import read_toml


@command
def effects(
    name: Annotated[str | None, Argument(metavar="ID", help="One effect; all of them if not given.")] = None,
    effects_file: arg.EffectsFile = None,
) -> None:
    """Explain the effects that the tool knows: cause, formula, parameters, what data it takes to see them."""
    catalogue = (*catalogue_with(effects_file), *FREE_FORMS)
    chosen = [kind for kind in catalogue if name in (None, kind.id)]
    if not chosen:
        raise UnknownName("effect", str(name), [kind.id for kind in catalogue])
    for kind in chosen:
        show(*effect_blocks(kind, in_full=name is not None))


@command
def diagnose(
    model: arg.ModelPath,
    data: arg.DataFile,
    json: arg.JsonFile = None,
    figure: arg.FigureFile = None,
    show_all: arg.ShowAll = False,
    effects_file: arg.EffectsFile = None,
    prior: arg.FleetPrior = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Find out which physical effect a model misses, that none is missing, or that no known one explains it."""
    inputs = read_identifiable(model, data, effects_file, reading)
    rates = None if prior is None else load_rates(prior)
    with progress("trying every effect at every place") as tick:
        found = run_diagnose(inputs.model, inputs.data, inputs.catalogue, tick, inputs.loss, rates)
    with log.status("cross-validating") as status:
        report = build_report(found, status.update)
    publish(diagnosis_document(report), json, figure, partial(draw_report, report), None if show_all else LISTED)


@command
def add(
    model: arg.ModelPath,
    data: arg.DataFile,
    effect: Annotated[str, Argument(metavar="EFFECT[@PLACE]", help="For instance backlash@joint2.")],
    output: arg.NewModel,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Add an effect, refit everything, print the error before and after, and append the step to the model's history.

    The loss is that of the model's last fit, and poses that `diagnose` calls outliers are left out.
    """
    inputs = read_identifiable(model, data, effects_file, reading)
    effects_at(inputs.model.arm, effect, inputs.catalogue)
    with progress("looking for outliers") as tick:
        found = run_diagnose(inputs.model, inputs.data, inputs.catalogue, tick, inputs.loss)
    if found.outliers:
        notice(f"outliers, left out: poses {', '.join(map(str, found.outliers))}")
    with named_progress() as named:
        taken = add_step(inputs, found, effect, named)
    publish(taken.document, json, most=None if show_all else LISTED)
    write_text(output, model_text(taken.file))
    show(f"Model written to {output}")


@command
def undo(model: arg.ModelPath, output: arg.NewModel) -> None:
    """Take the last step of a model's history back, exactly."""
    restored = undo_step(read_toml(model, ModelFile))
    write_text(output, model_text(restored))
    known = restored.provenance
    how = "" if known is None else fit_words(known.loss, known.left_out)
    show(f"Back before the last step{how and f' ({how})'}; model written to {output}")


@command
def auto(
    model: arg.ModelPath,
    data: arg.DataFile,
    output: arg.NewModel,
    max_effects: Annotated[int, Option(min=0, help="Stop after this many.")] = 20,
    nested: Annotated[
        bool, Option("--nested/--no-nested", help="Also choose the effects anew in every fold: honest, but longer.")
    ] = True,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
    effects_file: arg.EffectsFile = None,
    cluster: arg.Cluster = None,
    prior: arg.FleetPrior = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Follow the tool's own advice, effect by effect, until it says stop.

    With --prior: effects that arms of this kind often have need less evidence, and at the end all parameters are fitted
    together with the prior.
    """
    inputs = read_identifiable(model, data, effects_file, reading)
    file, the_model, measured, catalogue = inputs.file, inputs.model, inputs.data, inputs.catalogue
    numbers, loss = count(), inputs.loss
    rates = None if prior is None else load_rates(prior)

    def on_step(step: AutoStep) -> None:
        """Prints a step as soon as it is taken."""
        show(*step_blocks(next(numbers), step))

    course = run_auto(the_model, measured, max_effects, catalogue, on_step, loss, rates=rates)
    last = course.steps[-1]
    held_out = HeldOutResidual(last.held_out)
    *_, final = file, *auto_files(inputs, course.steps)
    title = f"{len(course.steps) - 1} effects added (held out: effects chosen on all poses)"
    errors = ErrorSummary(nominal_error(the_model.arm, last.data), error_stats(last.fit.residual), held_out)
    show(*errors.blocks(title))
    with_prior: ErrorSummary | None = None
    if prior is not None:
        final, with_prior = prior_step(final, course.model, last.data, prior, catalogue, loss)
        show(*with_prior.blocks(f"Then {final.history[-1].step}: all {len(final.sigma)} parameters fitted"))
    write_text(output, model_text(final))
    show(f"Model written to {output}")
    whole = HeldOutResidual(None, "not requested (--no-nested)")
    if nested:
        with executor_for(cluster, effects_file, FOLDS) as pool, progress("choosing anew in every fold") as tick:
            whole = nested_held_out(the_model, measured, pool, max_effects, catalogue, tick, loss, rates)
    publish(
        course_document(course, report_of(course.judgement), held_out, whole, with_prior),
        json,
        most=None if show_all else LISTED,
    )


@command
def selftest(
    arm: arg.ArmArgument,
    poses: arg.PosesFile,
    only: Annotated[str, Option(help="Only effects that match, for instance 'backlash@*'.")] = "*",
    noise_mm: arg.NoiseMm = 0.3,
    seed: Annotated[int, Option(help="Of the arm's errors and the noise.")] = 0,
    json: arg.JsonFile = None,
    effects_file: arg.EffectsFile = None,
    cluster: arg.Cluster = None,
) -> None:
    """Tell before measuring whether a plan of poses can find what you look for.

    Injects each effect at its typical size into an arm with random errors, at your poses; prints what would be named.
    """
    plan = InjectionPlan(arm, load_poses(poses, load_arm(arm)), noise_mm * MM, seed, effects_file)
    names, refused = detectable_effects(plan, only)
    if not names:
        raise LrmError(f"no effect that these poses can show matches '{only}'")
    with executor_for(cluster, effects_file, len(names)) as pool, progress(f"injecting {len(names)} effects") as tick:
        trials = sorted(run_trials(plan, names, pool, tick), key=lambda trial: names.index(trial.truth))
    publish(selftest_document(len(plan.poses), trials, refused), json)
