"""The tasks of the workbench, done: by the functions of the commands, on the files that the commands would read."""

from __future__ import annotations

import pickle
from collections.abc import Iterable
from dataclasses import replace
from functools import singledispatch
from itertools import count

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.metadata import arm_for
from lrm_ident.diagnosis.auto import AutoStep
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.laws.law_file import law_id
from lrm_ident.fitting.effect_plugins import sha256_of
from lrm_ident.fitting.progress import Progress
from lrm_ident.report.document_html import blocks_html
from lrm_ident.report.findings import Findings, first_look, with_comparison, with_diagnosis
from lrm_ident.report.laws import proposal_document
from lrm_ident.study.inputs import read_measurements, read_study
from lrm_ident.study.study import Study
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
from lrm_ident.workbench.work.worker import Say, WorkFailure, WorkNotice, WorkProgress, WorkResult

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
    if task.model is not None:
        study = read_study(task.model, task.data, task.effects_file, task.reading)
        _tell(study.notices, say)
        study.save(task.kept)
        say(WorkResult(step_found(files, first_look(study))))
        return
    name, arm = arm_for(task.data, task.arm)
    data = read_measurements(task.data, arm, name, task.reading)
    _tell(data.notices, say)
    say(WorkProgress("fitting"))
    study = Study.of(data, progress=_bars(say)).fit()
    study.save(task.kept)
    _say_step(files, say)


@do.register
def look(task: CompareTask, say: Say) -> None:
    """Reads the files anew."""
    say(WorkProgress("reading the files"))
    _say_step(task.files, say)


@do.register
def diagnose_step(task: DiagnoseTask, say: Say) -> None:
    """Compares, then diagnoses."""
    say(WorkProgress("held-out error"))
    study = _study(task.files, say)
    found = with_comparison(unpacked(task.packed), study.compare())
    say(WorkResult(step_found(task.files, found)))
    found = with_diagnosis(found, study.diagnose(screened=_screened(task.files, study)))
    say(WorkResult(step_found(task.files, found)))


@do.register
def add_effect(task: AddTask, say: Say) -> None:
    """Adds the effect, refits everything, and keeps the model."""
    say(WorkProgress(f"adding {task.effect}: looking for outliers"))
    study = _study(task.files, say)
    screened = _screened(task.files, study)
    say(WorkProgress(f"adding {task.effect}: refitting everything"))
    study.add(task.effect, screened).save(task.kept)
    _say_step(replace(task.files, model=task.kept), say)


@do.register
def follow_advice(task: AutoTask, say: Say) -> None:
    """Takes step after step and keeps each."""
    numbers = count(task.number)

    def on_step(step: AutoStep, study: Study) -> None:
        """Keeps the model of a step, and reports it to the page."""
        if step.added:
            kept = task.folder / kept_name(next(numbers))
            study.save(kept)
            _say_step(replace(task.files, model=kept), say)

    _study(task.files, say).auto(on_step=on_step)


@do.register
def propose(task: ProposeTask, say: Say) -> None:
    """Looks for a law, and keeps its file."""
    found = _study(task.files, say).propose()
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


def _study(files: OpenFiles, say: Say) -> Study:
    """The study of files whose notices were shown before; it says what it does. Raises `FileError`."""
    return read_study(files.model, files.data, files.effects_file, files.reading, _bars(say))


def _tell(notices: Iterable[str], say: Say) -> None:
    for words in notices:
        say(WorkNotice(words))


def _say_step(files: OpenFiles, say: Say) -> None:
    study = _study(files, say)
    _tell(study.notices, say)
    say(WorkResult(step_found(files, first_look(study))))


def _bars(say: Say) -> Progress:
    return lambda what, done, of: say(WorkProgress(what, done, of))


def _screened(files: OpenFiles, study: Study) -> Diagnosis:
    """The screening of a step, made once in a process: `add` needs the one that its ranking came from."""
    content = f"{sha256_of(files.model)} {study.data.sha256} {files.effects_file}"
    if content not in _LAST:
        found = study.screen()
        _LAST.clear()
        _LAST[content] = found
    return _LAST[content]
