"""The tasks of the workbench, done: by the functions of the commands, on the files that the commands would read."""

from __future__ import annotations

import pickle
from collections.abc import Iterable
from dataclasses import replace
from functools import singledispatch
from pathlib import Path

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.conventions import arm_for
from lrm_ident.data.measurements import Measurements, Part, every_pose
from lrm_ident.data.wording import in_mm
from lrm_ident.diagnosis.candidate_trial import Refit
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.step import Step
from lrm_ident.diagnosis.symbolic_regression.law_file import law_id
from lrm_ident.fitting.effect_plugins import sha256_of
from lrm_ident.fitting.levenberg_marquardt import check_enough
from lrm_ident.fitting.progress import Progress
from lrm_ident.report.diagnosis.course import proposal_document
from lrm_ident.report.document import blocks_html
from lrm_ident.report.model_report import ModelReport, after_step, quick_report, with_comparison, with_diagnosis
from lrm_ident.report.plots.interactive.values import figure_values, values_text
from lrm_ident.residual.thresholds import MAX_EFFECTS
from lrm_ident.study.inputs import read_measurements, read_study
from lrm_ident.study.model_history import model_text, undo_step
from lrm_ident.study.notices import Notice
from lrm_ident.study.study import Study
from lrm_ident.workbench.html_report import numbers_html
from lrm_ident.workbench.work import tasks
from lrm_ident.workbench.work.next_poses import next_poses
from lrm_math.arm.arm import Arm
from lrm_math.errors import LrmError
from lrm_math.model.reading import Reading

_LAST: dict[str, Diagnosis] = {}
"""The last diagnosis, by the hashes of its files."""
_READ: dict[str, tuple[Arm, Measurements]] = {}
"""The last measurements, of an arm, by the hashes of their files and how they are read."""


@singledispatch
def run_task(task: tasks.WorkTask, send: tasks.Send) -> None:
    """Does a task; sends how far it is, and its results. Raises `LrmError`."""
    send(tasks.WorkDone(f"no work is known for {type(task).__name__}"))


@run_task.register
def open_files(task: tasks.OpenTask, send: tasks.Send) -> None:
    """Reads the files, fits a model if there is none, and keeps it."""
    send(tasks.WorkProgress("reading the files"))
    files = tasks.OpenFiles(task.kept, task.data, task.effects_file, task.reading)
    if task.model is not None:
        study = read_study(task.model, task.data, task.effects_file, task.reading, read=_read)
        check_enough(len(study.data), len(study.model.free), study.prior)
        _tell(study.notices, send)
        study.save(task.kept)
        send(step_found(files, quick_report(study), files.command("compare")))
        return
    name, arm = arm_for(task.data, task.arm)
    data = _read(task.data, arm, name, task.reading, None, every_pose)
    _tell(data.source.notices, send)
    send(tasks.WorkProgress("fitting"))
    study = Study.of(data, progress=_bars(send)).fit()
    study.save(task.kept)
    words = ("fit", task.data, "-o", task.kept, *(() if task.arm is None else ("--arm", task.arm)))
    _send_step(files, send, tasks.DoneCommand(words, None, task.reading))


@run_task.register
def look(task: tasks.CompareTask, send: tasks.Send) -> None:
    """Reads the files anew."""
    send(tasks.WorkProgress("reading the files"))
    _send_step(task.files, send)


@run_task.register
def diagnose_step(task: tasks.DiagnoseTask, send: tasks.Send) -> None:
    """Compares, then diagnoses."""
    send(tasks.WorkProgress("held-out error"))
    study = _study(task.files, send)
    compared = study.compare()
    report = with_comparison(tasks.unpacked(task.packed), compared)
    send(step_found(task.files, report))
    report = with_diagnosis(report, study.diagnose(screened=_screened(task.files, study), compared=compared))
    send(step_found(task.files, report))


@run_task.register
def add_effect(task: tasks.AddTask, send: tasks.Send) -> None:
    """Adds the effect, refits everything, and keeps the model; a field is added to the fit as it is."""
    study = _study(task.files, send)
    if task.effect == tasks.FIELD:
        study.add_field().save(task.kept)
    else:
        send(tasks.WorkProgress(f"adding {task.effect}: looking for outliers"))
        screened = _screened(task.files, study)
        send(tasks.WorkProgress(f"adding {task.effect}: refitting everything"))
        study.add(task.effect, screened).save(task.kept)
    command = task.files.command("add", task.effect, "-o", task.kept)
    _send_step(replace(task.files, model=task.kept), send, command, task.packed)


@run_task.register
def follow_advice(task: tasks.AutoTask, send: tasks.Send) -> None:
    """Takes step after step and keeps each."""
    errors, coming, packed, taken = list[str](), list[str](), task.packed, 0

    def on_confirmed(refit: Refit) -> None:
        """Notes the error that the step which is coming will have."""
        coming[:] = [in_mm(refit.error.rms)]

    def on_step(step: Step, study: Study) -> None:
        """Keeps the model of a step, and reports it to the page."""
        nonlocal packed, taken
        errors.append(in_mm(step.held_out_rms))
        coming.clear()
        if step.added:
            kept, taken = task.kept / tasks.kept_name(task.number + taken), taken + 1
            study.save(kept)
            command = task.files.command("auto", "-o", kept, "--max-effects", str(taken), "--no-nested")
            packed = _send_step(replace(task.files, model=kept), send, command, packed)

    def on_progress(what: str, done: int, of: int) -> None:
        """Says which round it is, and how far the last one brought the error."""
        errors_so_far = [*errors, *coming]
        fall = f": {' → '.join(errors_so_far[-2:])} mm" if errors_so_far else ""
        words = f"auto, round {max(len(errors_so_far), 1)} of at most {MAX_EFFECTS}{fall}; {what}"
        send(tasks.WorkProgress(words, done, of))

    study = replace(_study(task.files, send), progress=on_progress)
    study.auto(on_step=on_step, on_confirmed=on_confirmed)


@run_task.register
def propose(task: tasks.ProposeTask, send: tasks.Send) -> None:
    """Looks for a law, and keeps its file."""
    proposal = _study(task.files, send).propose()
    title, *rest = proposal_document(proposal).blocks
    result = tasks.SearchResult(str(title), blocks_html(rest), command=task.files.command("propose"))
    if proposal.best is not None:
        write_text(task.kept, proposal.best.source)
        effect = f"{law_id(proposal.best.law)}@joint{proposal.best.law.joint + 1}"
        command = task.files.command("propose", "-o", task.kept)
        result = replace(result, command=command, file=task.kept, effect=effect)
    send(result)


@run_task.register
def choose_next(task: tasks.PosesTask, send: tasks.Send) -> None:
    """Chooses the next poses, and keeps their file; what cannot be is said of the user's own file."""
    send(tasks.WorkProgress("reading the files"))
    try:
        send(next_poses(_study(task.files, send), task, _bars(send)))
    except LrmError as error:
        problem = str(error)
        for path in (task.files.data, task.files.model):
            problem = problem.replace(str(path), path.name)
        send(tasks.SearchResult(f"No poses were chosen after those of {task.files.data.name}", problem=problem))


def step_found(
    files: tasks.OpenFiles, report: ModelReport, command: tasks.DoneCommand | None = None
) -> tasks.StepResult:
    """Result of a step: title, verdict, figures and tables of its report, for the page."""
    file = report.file
    return tasks.StepResult(
        files,
        title=f"{file.arm} · {report.poses.source.path.name} · {report.field.poses} poses",
        data_sha256=report.poses.source.sha256,
        diagnosed=report.diagnosis is not None,
        complete=report.diagnosis is not None and report.diagnosis.values["verdict"] == "nothing_missing",
        values=values_text(figure_values(report)),
        numbers=numbers_html(report),
        model=model_text(file),
        before=model_text(undo_step(file)) if len(file.history) > 1 else None,
        packed=pickle.dumps(report),
        command=command,
    )


def _study(files: tasks.OpenFiles, send: tasks.Send) -> Study:
    """The study of files whose notices were shown before; it says what it does. Raises `FileError`."""
    return read_study(files.model, files.data, files.effects_file, files.reading, _bars(send), read=_read)


def _read(path: Path, arm: Arm, arm_name: str, reading: Reading, usual: Reading | None, part: Part) -> Measurements:
    """Measurements, read anew only where files or reading have changed. Raises `FileError`, `Misread`."""
    beside = path.with_suffix(".toml")
    hashes = (sha256_of(file) if file.is_file() else "" for file in (path, beside))
    content = f"{path} {' '.join(hashes)} {arm_name} {reading!r} {usual!r} {part!r}"
    known_arm, data = _READ.get(content, (None, None))
    if data is None or known_arm != arm:
        data = read_measurements(path, arm, arm_name, reading, usual, part)
        _READ.clear()
        _READ[content] = arm, data
    return data


def _tell(notices: Iterable[str | Notice], send: tasks.Send) -> None:
    for notice in notices:
        send(tasks.WorkNotice(str(notice)))


def _send_step(
    files: tasks.OpenFiles, send: tasks.Send, command: tasks.DoneCommand | None = None, before: bytes | None = None
) -> bytes:
    """Sends the step of files; gives all that is known of it, packed. `before`: the same of the step before."""
    study = _study(files, send)
    _tell(study.notices, send)
    report = quick_report(study)
    step = step_found(files, report if before is None else after_step(report, tasks.unpacked(before)), command)
    send(step)
    return step.packed


def _bars(send: tasks.Send) -> Progress:
    return lambda what, done, of: send(tasks.WorkProgress(what, done, of))


def _screened(files: tasks.OpenFiles, study: Study) -> Diagnosis:
    """The screening of a step, made once in a process: `add` needs the one that its ranking came from."""
    content = f"{sha256_of(files.model)} {study.data.source.sha256} {files.effects_file}"
    if content not in _LAST:
        screening = study.screen()
        _LAST.clear()
        _LAST[content] = screening
    return _LAST[content]
