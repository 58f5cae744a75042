"""Commands that find what is missing: diagnose, add, auto, propose, selftest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Annotated

from typer import Argument, Exit, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import (
    TakesLonger,
    identifiable,
    notice,
    opened,
    pausing_bars,
    progress,
    publish,
    read_poses,
    show,
    timed,
    with_dimensions,
)
from lrm_ident.cli.consoles import log
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.wording import in_minutes
from lrm_ident.diagnosis.step import Step
from lrm_ident.fitting.cross_validation import FOLDS
from lrm_ident.fitting.executors import executor_for, processes_for
from lrm_ident.fitting.priors import load_rates
from lrm_ident.fitting.progress import TimeOfParts
from lrm_ident.report.diagnosis.course import course_document, proposal_document, step_blocks, step_document
from lrm_ident.report.diagnosis.diagnosis import diagnosis_document
from lrm_ident.report.diagnosis.selftest import selftest_document
from lrm_ident.report.document import write
from lrm_ident.report.effects import WHAT_A_FIELD_IS
from lrm_ident.report.fit import error_blocks
from lrm_ident.report.plots.diagnosis import draw_report
from lrm_ident.report.step_card import of_data
from lrm_ident.report.story import story_of_file
from lrm_ident.report.text.next_steps import CommandNames
from lrm_ident.residual.error_breakdown import NestedResidual
from lrm_ident.residual.thresholds import MAX_EFFECTS
from lrm_ident.study.field_step import NoBetterPrediction
from lrm_ident.study.inputs import read_study
from lrm_ident.study.model_history import check_replaces
from lrm_ident.study.model_on_data import ErrorSummary
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.errors import LrmError
from lrm_math.model.deployed_model import field_of
from lrm_math.model.reading import AS_NAMED, Reading

UNASKED_S = 120.0
"""Time that choosing the effects anew in every fold may take without being asked for."""


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
    """Find the physical effect that a model is missing, or report that none is, or that none explains the error."""
    rates = None if prior is None else load_rates(prior)
    with opened(model, data, effects_file, reading) as study:
        report = identifiable(study).diagnose(rates)
        document = diagnosis_document(report, names_of(study, model, data))
    publish(document, json, figure, partial(draw_report, report), show_all)


@command
def add(
    model: arg.ModelPath,
    data: arg.DataFile,
    effect: Annotated[str, Argument(metavar="EFFECT[@PLACE]", help="Effect to add, for instance backlash@joint2.")],
    output: arg.NewModel,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
    force: arg.Force = False,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Add an effect, refit everything, print the error before and after, and append the step to the model's history.

    The loss is that of the model's last fit, and poses that `diagnose` calls outliers are left out.
    """
    with opened(model, data, effects_file, reading) as read:
        study = identifiable(read)
        after = study.add(effect)
        notice(*after.notices[len(study.notices) :])
        before, errors, covariance = after.errors_before, after.errors, study.covariance
    if not force:
        check_replaces(output, len(after.file.history))
    after.save(output)
    show(f"Model written to {output}")
    files = str(output), str(data)
    publish(step_document(effect, after.taken, before, errors, covariance, files), json, in_full=show_all)


@command
def auto(
    model: arg.ModelPath,
    data: arg.DataFile,
    output: arg.NewModel,
    max_effects: Annotated[int, Option(min=0, help="Add at most this many effects.")] = MAX_EFFECTS,
    nested: Annotated[
        bool | None,
        Option(
            "--nested/--no-nested",
            help="Also cross-validate the choice of effects (nested): about ten times longer. Default: where that "
            "takes no more than two minutes.",
        ),
    ] = None,
    field: Annotated[
        bool,
        Option(
            "--field",
            help="At the end, add a black-box term for the remaining error if the model predicts better with it.",
        ),
    ] = False,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
    force: arg.Force = False,
    effects_file: arg.EffectsFile = None,
    cluster: arg.Cluster = None,
    prior: arg.FleetPrior = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Add missing effects one by one, each confirmed by cross-validation, until none is found.

    Reports which effects are identified causes, which are candidates, and which are empirical terms.

    With --prior, effects that arms of this kind often have need less evidence, and at the end all parameters are fitted
    together with the prior. With --field, a black-box term also predicts the remaining error.
    """
    read = read_study(model, data, effects_file, reading)
    notice(*read.notices)
    if not force:
        check_replaces(output, len(read.file.history))
    study = with_dimensions(read)
    begun, taken = monotonic(), list[Step]()
    rates = None if prior is None else load_rates(prior)

    def on_step(step: Step, after: Study) -> None:
        """Prints a step on stderr as soon as it is taken; its model is on disk whatever comes then."""
        taken.append(step)
        pause()
        write(log, step_blocks(taken, nominal_rms(study)))
        after.save(output)

    with kept_when_interrupted(output, taken), pausing_bars() as (tick, pause):
        course, then = replace(study, progress=tick).auto(max_effects, rates, on_step)
    after = replace(then, progress=study.progress)
    added = len(course.steps) - 1
    tables = error_blocks(after.errors, f"{added} effect{'' if added == 1 else 's'} added, chosen on all poses")
    with_prior: ErrorSummary | None = None
    final = after
    if prior is not None:
        final = after.fit_all(prior)
        with_prior, last = final.errors, final.file.history[-1]
        show(*error_blocks(with_prior, f"Then {last.step}: all {len(last.sigma)} parameters fitted"))
    if field:
        final = _with_field(final)
    final.save(output)
    show(f"Model written to {output}")
    whole = NestedResidual(None, "not requested (--no-nested)")
    expected = (monotonic() - begun) * (1 if cluster else -(-FOLDS // processes_for(FOLDS)))
    if nested is None and expected > UNASKED_S:
        whole = NestedResidual(None, f"it would take about {in_minutes(expected)}; ask for it with --nested")
    elif nested is not False:
        notice(f"cross-validating the choice of effects ({FOLDS} folds, about {in_minutes(expected)}; Ctrl-C skips it)")
        time = TimeOfParts(FOLDS if cluster else processes_for(FOLDS))
        try:
            with (
                executor_for(cluster, effects_file, FOLDS) as pool,
                timed(time, None if nested else UNASKED_S) as shown,
            ):
                whole = replace(study, progress=shown).nested_held_out(
                    pool, max_effects, rates, course.diagnosis.outliers
                )
        except TakesLonger as longer:
            least = in_minutes(longer.expected)
            whole = NestedResidual(None, f"it would take at least {least}; ask for it with --nested")
        except KeyboardInterrupt:
            whole = NestedResidual(None, "skipped by Ctrl-C; ask for it with --nested")
    final = final.with_course(course, whole)
    final.save(output)
    names, with_field = names_of(study, output, data), None if field_of(final.model) is None else final.errors
    publish(
        course_document(
            course, after.held_out, whole, with_prior, with_field, names, story_of_file(final.file), tables
        ),
        json,
        in_full=show_all,
    )


def nominal_rms(study: Study) -> float | None:
    """RMS error (m) of the nominal arm on a study's data, where its model file has it of these."""
    first = study.file.history[0] if study.file.history else None
    if first is None or first.nominal_rms_mm is None or not of_data(first, study.data.source.sha256):
        return None
    return first.nominal_rms_mm * MM


def names_of(study: Study, model: Path, data: Path) -> CommandNames:
    """Names of the files for the commands that a result advises."""
    return CommandNames(str(model), str(data), study.file.arm)


def _with_field(study: Study) -> Study:
    """Adds a residual field, or leaves the study as it is and prints one line that says why."""
    try:
        then = study.add_field()
    except NoBetterPrediction as refused:
        show(f"{str(refused)[0].upper()}{str(refused)[1:]}.")
        return study
    show(*error_blocks(then.errors, f"Then a residual field, {WHAT_A_FIELD_IS}"))
    return then


@contextmanager
def kept_when_interrupted(output: Path, taken: Sequence[Step]) -> Iterator[None]:
    """Ends with exit code 130 and one line where a person interrupts: the model of the last step is written already."""
    try:
        yield
    except KeyboardInterrupt:
        notice(f"interrupted; {f'the model of the last step is in {output}' if taken else 'no step was taken'}")
        raise Exit(130) from None


@command
def propose(
    model: arg.ModelPath,
    data: arg.DataFile,
    output: Annotated[
        Path | None, Option("-o", "--output", metavar="LAW.py", help="Where to write the formula, as a Python file.")
    ] = None,
    json: arg.JsonFile = None,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Search for a formula where no known effect fits: a small grammar at every joint, judged by held-out error.

    Writes the best formula as an effect of your own (docs/effects.md): read it, then add it with --effects-file.
    """
    from lrm_ident.diagnosis.symbolic_regression.law_file import law_id

    with opened(model, data, effects_file, reading) as study:
        proposal = identifiable(study).propose()
    publish(proposal_document(proposal), json)
    if proposal.best is None:
        return
    law = proposal.best.law
    if output is None:
        show("Not saved; give -o LAW.py to keep it.")
    else:
        write_text(output, proposal.best.source)
        show(
            f"Formula written to {output}",
            f"Add it with: lrm-ident add {model} {data} {law_id(law)}@joint{law.joint + 1} "
            f"--effects-file {output} -o MODEL2",
        )


@command
def selftest(
    arm: arg.ArmArgument,
    poses: arg.PosesFile,
    only: Annotated[str, Option(help="Only effects that match, for instance 'backlash@*'.")] = "*",
    noise_mm: arg.NoiseMm = 0.3,
    seed: Annotated[int, Option(help="Seed of the arm's errors and of the noise.")] = 0,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
    effects_file: arg.EffectsFile = None,
    cluster: arg.Cluster = None,
) -> None:
    """Predict which effects a set of poses can detect, before measuring.

    Injects each effect at its typical size into a simulated arm with random errors, and prints which ones it finds.
    """
    from lrm_ident.diagnosis.inject_recover import InjectionPlan, detectable_effects, run_trials

    plan = InjectionPlan(arm, read_poses(poses, load_arm(arm)), noise_mm * MM, seed, effects_file)
    names, refused = detectable_effects(plan, only)
    if not names:
        raise LrmError(f"no effect that these poses can show matches '{only}'")
    with executor_for(cluster, effects_file, len(names)) as pool, progress(f"injecting {len(names)} effects") as tick:
        trials = sorted(run_trials(plan, names, pool, tick), key=lambda trial: names.index(trial.truth))
    publish(selftest_document(len(plan.poses), trials, refused), json, in_full=show_all)
