"""What the workbench asks its process to do: open files, diagnose, add an effect, propose a law, follow the advice.

Every task reads the files that the commands would read, by the same functions, and its steps are model files.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from lrm_ident.data.apply_reading import AS_NAMED
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.metadata import arm_for
from lrm_ident.diagnosis.auto import AutoStep, run_auto
from lrm_ident.diagnosis.diagnose import Diagnosis, diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.effect_plugins import sha256_of
from lrm_ident.estimation.error_breakdown import compare
from lrm_ident.estimation.model_history import arm_name_for, model_text
from lrm_ident.estimation.priors import prior_of_file
from lrm_ident.laws.law_file import law_id
from lrm_ident.laws.proposal import propose_law
from lrm_ident.page.worker import Say, WorkMessage, WorkNotice, WorkProgress, WorkResult
from lrm_ident.progress import OnProgress
from lrm_ident.report.document import Document
from lrm_ident.report.laws import proposal_document
from lrm_ident.workflow.findings import Findings, first_look, with_comparison, with_diagnosis
from lrm_ident.workflow.inputs import ModelInputs, identifiable, read_inputs, read_measurements
from lrm_ident.workflow.steps import add_step, auto_files, first_fit
from lrm_math.arm.arm_file import shipped_arms
from lrm_math.model.model_file import ModelFile
from lrm_math.model.reading import Reading
from lrm_math.toml_file import read_toml

MOST_EFFECTS = 20
_LAST: dict[str, Diagnosis] = {}
"""The last diagnosis, by the hashes of its files."""


@dataclass(frozen=True)
class OpenFiles:
    """The files of a session: a model and measurements, and how they are read, as the options of the commands say."""

    model: Path
    data: Path
    effects_file: Path | None = None
    reading: Reading = field(default=AS_NAMED)

    def inputs(self, say: Say) -> ModelInputs:
        """Read and checked as every command does. Raises `FileError`."""
        notice = lambda words: say(WorkNotice(words))  # noqa: E731
        return read_inputs(self.model, self.data, self.effects_file, notice, self.reading)


@dataclass(frozen=True)
class StepFound:
    """A step: the files with its model, and what is known of it so far."""

    files: OpenFiles
    findings: Findings


@dataclass(frozen=True)
class LawFound:
    """A proposed law: what `propose` prints; its file and name, if a law is proposed."""

    document: Document
    file: Path | None = None
    name: str = ""


@dataclass(frozen=True)
class OpenTask:
    """Opens measurements and a model, or fits one first; the model is kept as `kept`."""

    data: Path
    model: Path | None
    arm: str | None = None
    effects_file: Path | None = None
    reading: Reading = field(default=AS_NAMED)
    kept: Path = Path("step-0.toml")

    def run(self, say: Say) -> None:
        """Says one step."""
        say(WorkProgress("reading the files"))
        if self.model is None:
            name, arm = arm_for(self.data, self.arm)
            data = read_measurements(self.data, arm, name, lambda words: say(WorkNotice(words)), self.reading)
            say(WorkProgress("fitting"))
            file = first_fit(arm, arm_name_for(name, self.kept.parent), data, partial(_bar, say)).file
        else:
            file = read_toml(self.model, ModelFile)
            named = self.model.parent / file.arm
            arm_name = file.arm if file.arm in shipped_arms() or not named.exists() else str(named.resolve())
            file = file.model_copy(update={"arm": arm_name})
            read_inputs(self.model, self.data, self.effects_file, lambda _: None, self.reading)
        write_text(self.kept, model_text(file))
        _say_step(OpenFiles(self.kept, self.data, self.effects_file, self.reading), say)


@dataclass(frozen=True)
class LookTask:
    """A first look at a step, for instance after the measurements have grown."""

    files: OpenFiles

    def run(self, say: Say) -> None:
        """Says one step."""
        say(WorkProgress("reading the files"))
        _say_step(self.files, say)


@dataclass(frozen=True)
class DiagnoseTask:
    """`compare` and `diagnose` of a step that has been looked at."""

    files: OpenFiles
    found: Findings

    def run(self, say: Say) -> None:
        """Says the step with the comparison, then with the diagnosis too."""
        say(WorkProgress("held-out error"))
        inputs = self.files.inputs(silent_say)
        prior = prior_of_file(inputs.file, inputs.model, inputs.catalogue)
        compared = compare(inputs.model, inputs.data, _bar(say, "held-out error"), prior, inputs.loss)
        found = with_comparison(self.found, compared)
        say(WorkResult(StepFound(self.files, found)))
        report = build_report(_diagnosis(self.files, say), lambda what: say(WorkProgress(what)))
        say(WorkResult(StepFound(self.files, with_diagnosis(found, report))))


@dataclass(frozen=True)
class AddTask:
    """`add`: an effect at a place; the new model is kept as `kept`."""

    files: OpenFiles
    effect: str
    kept: Path

    def run(self, say: Say) -> None:
        """Says one step."""
        say(WorkProgress(f"adding {self.effect}: looking for outliers"))
        found = _diagnosis(self.files, say)
        say(WorkProgress(f"adding {self.effect}: refitting everything"))
        inputs = identifiable(self.files.inputs(silent_say), str)
        taken = add_step(inputs, found, self.effect, partial(_bar, say))
        write_text(self.kept, model_text(taken.file))
        _say_step(replace(self.files, model=self.kept), say)


@dataclass(frozen=True)
class AutoTask:
    """`auto`: follows the advice until it says stop; the models are kept in `folder`, numbered from `number`."""

    files: OpenFiles
    folder: Path
    number: int

    def run(self, say: Say) -> None:
        """Says every step as it is taken, and the last one with comparison and diagnosis."""
        inputs = identifiable(self.files.inputs(silent_say), str)
        now = [inputs]

        def on_step(step: AutoStep) -> None:
            for file in auto_files(now[-1], [step]):
                kept = self.folder / kept_name(self.number + len(now) - 1)
                write_text(kept, model_text(file))
                now.append(replace(inputs, file=file))
                _say_step(replace(self.files, model=kept), say)

        progress = _bar(say, "auto: looking for what is missing")
        run_auto(inputs.model, inputs.data, MOST_EFFECTS, inputs.catalogue, on_step, inputs.loss, progress)


@dataclass(frozen=True)
class ProposeTask:
    """`propose`: a law where no known effect fits; its file is kept as `kept`."""

    files: OpenFiles
    kept: Path

    def run(self, say: Say) -> None:
        """Says one law, or that there is none."""
        inputs = identifiable(self.files.inputs(silent_say), str)
        tick = _bar(say, "trying every law at every joint")
        found = propose_law(inputs.model, inputs.data, tick, lambda what: say(WorkProgress(what)), inputs.loss)
        document = proposal_document(found)
        if found.best is None:
            say(WorkResult(LawFound(document)))
            return
        write_text(self.kept, found.best.source)
        law = found.best.law
        say(WorkResult(LawFound(document, self.kept, f"{law_id(law)}@joint{law.joint + 1}")))


def kept_name(number: int) -> str:
    """Name of the file of a step."""
    return f"step-{number}.toml"


def silent_say(_: WorkMessage) -> None:
    """For files that have been read, and told of, before."""


def _say_step(files: OpenFiles, say: Say) -> None:
    say(WorkResult(StepFound(files, first_look(files.inputs(say)))))


def _bar(say: Say, what: str) -> OnProgress:
    say(WorkProgress(what))
    return lambda done, of: say(WorkProgress(what, done, of))


def _diagnosis(files: OpenFiles, say: Say) -> Diagnosis:
    """The diagnosis of a step, made once in a process: `add` needs the one that its ranking came from."""
    inputs = identifiable(files.inputs(silent_say), str)
    content = f"{sha256_of(files.model)} {inputs.data.sha256} {files.effects_file}"
    if content not in _LAST:
        tick = _bar(say, "trying every effect at every place")
        found = diagnose(inputs.model, inputs.data, inputs.catalogue, tick, inputs.loss)
        _LAST.clear()
        _LAST[content] = found
    return _LAST[content]
