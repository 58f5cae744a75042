"""The tasks of the workbench, done: by the functions of the commands, on the files that the commands would read."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import partial, singledispatch
from pathlib import Path

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.metadata import arm_for
from lrm_ident.diagnosis.auto import AutoStep, run_auto
from lrm_ident.diagnosis.diagnose import Diagnosis, diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.diagnosis.laws.law_file import law_id
from lrm_ident.diagnosis.laws.proposal import propose_law
from lrm_ident.fitting.effect_plugins import sha256_of
from lrm_ident.fitting.priors import prior_of_file
from lrm_ident.fitting.progress import OnProgress
from lrm_ident.report.document_html import blocks_html
from lrm_ident.report.findings import Findings, first_look, with_comparison, with_diagnosis
from lrm_ident.report.laws import proposal_document
from lrm_ident.residual.error_breakdown import compare
from lrm_ident.study.inputs import ModelInputs, OnNotice, identifiable, read_inputs, read_measurements
from lrm_ident.study.model_history import arm_name_for, model_text
from lrm_ident.study.steps import add_step, auto_files, first_fit
from lrm_ident.workbench.work.showing import step_shown
from lrm_ident.workbench.work.tasks import (
    AddTask,
    AutoTask,
    CompareTask,
    DiagnoseTask,
    LawResult,
    OpenFiles,
    OpenTask,
    ProposeTask,
    StepResult,
    WorkTask,
    kept_name,
    unpacked,
)
from lrm_ident.workbench.work.worker import Say, WorkFailure, WorkMessage, WorkNotice, WorkProgress, WorkResult
from lrm_math.arm.arm_file import shipped_arms

MOST_EFFECTS = 20
_LAST: dict[str, Diagnosis] = {}
"""The last diagnosis, by the hashes of its files."""


@singledispatch
def do(task: WorkTask, say: Say) -> None:
    """Does a task; says how far it is, and its results. Raises `LrmError`."""
    say(WorkFailure(f"no work is known for {type(task).__name__}"))


@do.register
def open_files(task: OpenTask, say: Say) -> None:
    """Reads the files, fits a model if there is none, and keeps it."""
    say(WorkProgress("reading the files"))
    files = OpenFiles(task.kept, task.data, task.effects_file, task.reading)
    if task.model is None:
        name, arm = arm_for(task.data, task.arm)
        data = read_measurements(task.data, arm, name, _notice(say), task.reading)
        say(WorkProgress("fitting"))
        file = first_fit(arm, arm_name_for(name, task.kept.parent), data, partial(_bar, say))
        write_text(task.kept, model_text(file))
        _say_step(files, say)
        return
    inputs = read_inputs(task.model, task.data, task.effects_file, _notice(say), task.reading)
    file = inputs.file.model_copy(update={"arm": _arm_of_copy(task.model, inputs.file.arm)})
    write_text(task.kept, model_text(file))
    say(WorkResult(step_found(files, first_look(replace(inputs, file=file)))))


@do.register
def look(task: CompareTask, say: Say) -> None:
    """Reads the files anew."""
    say(WorkProgress("reading the files"))
    _say_step(task.files, say)


@do.register
def diagnose_step(task: DiagnoseTask, say: Say) -> None:
    """Compares, then diagnoses."""
    say(WorkProgress("held-out error"))
    files = task.files
    inputs = _inputs(files, silent_say)
    prior = prior_of_file(inputs.file, inputs.model, inputs.catalogue)
    compared = compare(inputs.model, inputs.data, _bar(say, "held-out error"), prior, inputs.loss)
    found = with_comparison(unpacked(task.packed), compared)
    say(WorkResult(step_found(files, found)))
    report = build_report(_diagnosis(files, say), lambda what: say(WorkProgress(what)))
    say(WorkResult(step_found(files, with_diagnosis(found, report))))


@do.register
def add_effect(task: AddTask, say: Say) -> None:
    """Adds the effect, refits everything, and keeps the model."""
    say(WorkProgress(f"adding {task.effect}: looking for outliers"))
    found = _diagnosis(task.files, say)
    say(WorkProgress(f"adding {task.effect}: refitting everything"))
    inputs = identifiable(_inputs(task.files, silent_say), str)
    taken = add_step(inputs, found, task.effect, partial(_bar, say))
    write_text(task.kept, model_text(taken.file))
    _say_step(replace(task.files, model=task.kept), say)


@do.register
def follow_advice(task: AutoTask, say: Say) -> None:
    """Takes step after step and keeps each."""
    inputs = identifiable(_inputs(task.files, silent_say), str)
    now = [inputs]

    def on_step(step: AutoStep) -> None:
        """Keeps the model of a step, and reports it to the page."""
        for file in auto_files(now[-1], [step]):
            kept = task.folder / kept_name(task.number + len(now) - 1)
            write_text(kept, model_text(file))
            now.append(replace(inputs, file=file))
            _say_step(replace(task.files, model=kept), say)

    progress = _bar(say, "auto: looking for what is missing")
    run_auto(inputs.model, inputs.data, MOST_EFFECTS, inputs.catalogue, on_step, inputs.loss, progress)


@do.register
def propose(task: ProposeTask, say: Say) -> None:
    """Looks for a law, and keeps its file."""
    inputs = identifiable(_inputs(task.files, silent_say), str)
    tick = _bar(say, "trying every law at every joint")
    found = propose_law(inputs.model, inputs.data, tick, lambda what: say(WorkProgress(what)), inputs.loss)
    words = blocks_html(proposal_document(found).blocks)
    if found.best is None:
        say(WorkResult(LawResult(words)))
        return
    write_text(task.kept, found.best.source)
    law = found.best.law
    say(WorkResult(LawResult(words, task.kept, f"{law_id(law)}@joint{law.joint + 1}")))


def step_found(files: OpenFiles, found: Findings) -> StepResult:
    """What is known of a step, for the page."""
    return StepResult(files, step_shown(found), pickle.dumps(found))


def silent_say(_: WorkMessage) -> None:
    """For files that have been read, and reported, before."""


def _inputs(files: OpenFiles, say: Say) -> ModelInputs:
    """Read and checked as every command does. Raises `FileError`."""
    return read_inputs(files.model, files.data, files.effects_file, _notice(say), files.reading)


def _arm_of_copy(model: Path, arm: str) -> str:
    """The arm that a model file names, as a copy of it in another folder names it."""
    named = model.parent / arm
    return arm if arm in shipped_arms() or not named.exists() else str(named.resolve())


def _notice(say: Say) -> OnNotice:
    return lambda words: say(WorkNotice(words))


def _say_step(files: OpenFiles, say: Say) -> None:
    say(WorkResult(step_found(files, first_look(_inputs(files, say)))))


def _bar(say: Say, what: str) -> OnProgress:
    say(WorkProgress(what))
    return lambda done, of: say(WorkProgress(what, done, of))


def _diagnosis(files: OpenFiles, say: Say) -> Diagnosis:
    """The diagnosis of a step, made once in a process: `add` needs the one that its ranking came from."""
    inputs = identifiable(_inputs(files, silent_say), str)
    content = f"{sha256_of(files.model)} {inputs.data.sha256} {files.effects_file}"
    if content not in _LAST:
        tick = _bar(say, "trying every effect at every place")
        found = diagnose(inputs.model, inputs.data, inputs.catalogue, tick, inputs.loss)
        _LAST.clear()
        _LAST[content] = found
    return _LAST[content]
