"""The state of the workbench, without its page: steps, the work going on, and what a person may do next."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.output_files import check_outputs
from lrm_ident.effect_plugins import catalogue_with
from lrm_ident.estimation.model_history import model_text, undo_step
from lrm_ident.page.commands import DoneCommand
from lrm_ident.page.followed_file import FollowedFile, follow_file
from lrm_ident.page.html_report import html_report
from lrm_ident.page.tasks import (
    AddTask,
    AutoTask,
    DiagnoseTask,
    LawFound,
    LookTask,
    OpenTask,
    ProposeTask,
    StepFound,
    kept_name,
)
from lrm_ident.page.worker import (
    WorkDone,
    WorkFailure,
    WorkNotice,
    WorkProcess,
    WorkProgress,
    WorkResult,
    WorkTask,
)
from lrm_ident.workflow.findings import Findings
from lrm_math.errors import LrmError
from lrm_math.model.model import Model
from lrm_math.model.model_file import load_model

NOTICES_KEPT = 8


@dataclass
class WorkbenchSession:
    """One person's work on one model, shared by all tabs.

    Attributes:
        folder: where every step is kept as a file as soon as it is taken.
        steps: those taken, the last one being the model. law: the last proposed law.
        followed: the growing file that is shown, or None.
        progress: of the work going on, or None. failure: why the last work ended without a result, or "".
        version: grows with every change of the state, `drawn` with every change of what the figures show.
    """

    folder: Path
    worker: WorkProcess
    steps: list[StepFound] = field(default_factory=list)
    law: LawFound | None = None
    progress: WorkProgress | None = None
    failure: str = ""
    notices: list[str] = field(default_factory=list)
    done: list[DoneCommand] = field(default_factory=list)
    followed: FollowedFile | None = None
    version: int = 0
    drawn: int = 0
    _count: int = 0
    _next: WorkTask | None = None
    _at_work: WorkTask | None = None
    _model: tuple[Path, Model] | None = None

    # ---- what there is

    @property
    def step(self) -> StepFound | None:
        """The last step."""
        return self.steps[-1] if self.steps else None

    @property
    def findings(self) -> Findings | None:
        """What is known of the last step."""
        return self.steps[-1].findings if self.steps else None

    @property
    def busy(self) -> bool:
        """Whether work is going on that a person asked for; the diagnosis of a step gives way to it."""
        return self.worker.task is not None and not isinstance(self.worker.task, DiagnoseTask)

    @property
    def can_diagnose(self) -> bool:
        """Whether the last step has no diagnosis, and none is under way."""
        findings = self.findings
        return findings is not None and findings.diagnosis is None and self.worker.task is None

    @property
    def can_undo(self) -> bool:
        """Whether the model has a step to take back."""
        return not self.busy and self.findings is not None and len(self.findings.file.history) > 1

    # ---- what a person does

    def open(self, task: OpenTask) -> None:
        """Opens files, the model kept here; the steps so far stay as they are until that has worked."""
        self._give_way()
        self._begin(replace(task, kept=self.new_file()))

    def new_file(self) -> Path:
        """Where the next step is kept."""
        self._count += 1
        return self.folder / kept_name(self._count - 1)

    def add(self, effect: str) -> None:
        """Adds an effect at a place; waits for a diagnosis of this step that is under way, which it needs."""
        step = self._ready()
        self._begin(AddTask(step.files, effect, self.new_file()))

    def auto(self) -> None:
        """Follows the advice until it says stop."""
        step = self._ready()
        self._give_way()
        self._begin(AutoTask(step.files, self.folder, self._count))

    def propose(self) -> None:
        """Looks for a law."""
        step = self._ready()
        self._give_way()
        self._begin(ProposeTask(step.files, self.folder / f"law-{len(self.done)}.py"))

    def add_law(self) -> None:
        """Adds the proposed law, from its file. Raises `LrmError` if there is none."""
        step = self._ready()
        if self.law is None or self.law.file is None:
            raise LrmError("no law is proposed; press Propose a law first")
        if step.files.effects_file is not None:
            raise LrmError("this model has effects of its own already; add the law on the command line")
        self._give_way()
        files = replace(step.files, effects_file=self.law.file)
        self._begin(AddTask(files, self.law.name, self.new_file()))

    def undo(self) -> None:
        """Takes the last step back, exactly. Raises `LrmError` if there is none."""
        step = self._ready()
        file = undo_step(step.findings.file)
        self._give_way()
        kept = self.new_file()
        write_text(kept, model_text(file))
        self.done.append(DoneCommand(("undo", step.files.model, "-o", kept)))
        files = replace(step.files, model=kept)
        before = self.steps[-2] if len(self.steps) > 1 else None
        if before is not None and before.findings.file == file:
            self.steps[-2:] = [StepFound(files, before.findings)]
            self._changed(drawn=True)
            self._diagnose()
        else:
            self.steps.pop()
            self._begin(LookTask(files))

    def follow(self, source: Path) -> None:
        """Shows a file of measurements as it grows; nothing is diagnosed meanwhile. Raises `FileError`."""
        self._ready()
        self.followed = follow_file(source, self.folder)
        self._changed()

    def stop_following(self) -> None:
        """Goes on with the rows that there are."""
        self.followed = None
        self._diagnose()
        self._changed()

    def diagnose(self) -> None:
        """Compares and diagnoses the last step."""
        self._ready()
        self._diagnose()

    def cancel(self) -> None:
        """Ends the work; steps that are taken stay."""
        what = self.progress.what if self.progress else "the work"
        self.worker.cancel()
        self._next, self.progress = None, None
        self.failure = f"cancelled: {what}; the model is as it was after its last step"
        self._changed()

    def fail(self, words: str) -> None:
        """Tells why something could not be done."""
        self.failure = words
        self._changed()

    def save(self, path: Path) -> None:
        """Writes the model, with the checks of the commands. Raises `FileError`."""
        step = self._ready()
        check_outputs({"the model": path}, [step.files.data])
        write_text(path, model_text(step.findings.file))

    def report(self) -> str:
        """The report of the last step, as HTML. Raises `LrmError` if there is none yet."""
        return html_report(self._ready().findings)

    def model(self) -> Model:
        """The model of the last step. Raises `LrmError`."""
        step = self.step
        if step is None:
            raise LrmError("no model is open yet")
        if self._model is None or self._model[0] != step.files.model:
            catalogue = catalogue_with(step.files.effects_file)
            self._model = (step.files.model, load_model(step.files.model, catalogue))
        return self._model[1]

    # ---- what comes back

    def tick(self) -> None:
        """Takes what has come from the process; begins what waits."""
        for message in self.worker.messages():
            self._take(message)
        if self.followed is not None and self.worker.task is None:
            self._look_at(self.followed)
        if self.worker.task is None and self._next is not None:
            task, self._next = self._next, None
            self._begin(task)

    def _take(self, message: Any) -> None:
        if isinstance(message, WorkProgress):
            self.progress = message
        elif isinstance(message, WorkNotice):
            if message.words not in self.notices:
                self.notices = [*self.notices, message.words][-NOTICES_KEPT:]
        elif isinstance(message, WorkResult):
            self._take_result(message.value)
        elif isinstance(message, WorkFailure):
            self.failure, self.progress = message.words, None
            if not isinstance(self._at_work, DiagnoseTask):
                self._diagnose()
        elif isinstance(message, WorkDone):
            self.progress = None
            findings = self.findings
            if self._next is None and findings is not None and findings.diagnosis is None:
                self._diagnose()
        self._changed()

    def _take_result(self, value: StepFound | LawFound) -> None:
        task = self._at_work
        if isinstance(value, LawFound):
            self.law = value
            files = self.steps[-1].files
            kept = () if value.file is None else ("-o", value.file)
            words = ("propose", files.model, files.data, *kept)
            self.done.append(DoneCommand(words, files.effects_file, files.reading))
            self._changed(drawn=True)
            return
        if isinstance(task, OpenTask):
            self.steps, self.law, self.done = [], None, [_opened(task, value)]
        elif isinstance(task, AddTask):
            self._did(value, "add", *self._model_and_data(), task.effect, "-o", value.files.model)
        elif isinstance(task, AutoTask):
            taken = int(value.files.model.stem.split("-")[1]) - task.number + 1
            if taken > 1:
                self.done.pop()
            words = ("auto", task.files.model, task.files.data, "-o", value.files.model)
            self._did(value, *words, "--max-effects", str(taken), "--no-nested")
            self._count = task.number + taken
        if isinstance(task, DiagnoseTask):
            if not self.steps or self.steps[-1].files != value.files:
                return
            self.steps[-1] = value
        elif isinstance(task, LookTask) and self.steps and self.steps[-1].files.model == value.files.model:
            self.steps[-1] = value
        else:
            self.steps.append(value)
        self._changed(drawn=True)

    # ---- inside

    def _begin(self, task: WorkTask) -> None:
        """Starts a task now, or after the one at work."""
        if not isinstance(task, DiagnoseTask):
            self.failure = ""
        if self.worker.task is not None:
            self._next = task
        else:
            self._at_work = task
            self.worker.start(task)
        if not isinstance(task, DiagnoseTask) or self.progress is None:
            self.progress = WorkProgress("starting")
        self._changed()

    def _look_at(self, followed: FollowedFile) -> None:
        step = self.step
        try:
            if step is not None and followed.grown():
                self._begin(LookTask(replace(step.files, data=followed.copy)))
        except LrmError as error:
            self.followed = None
            self.fail(str(error))

    def _diagnose(self) -> None:
        step = self.step
        if step is not None and self.followed is None and step.findings.diagnosis is None and self.worker.task is None:
            self._begin(DiagnoseTask(step.files, step.findings))

    def _give_way(self) -> None:
        """Ends a diagnosis under way that nobody waits for."""
        if isinstance(self.worker.task, DiagnoseTask):
            self.worker.cancel()

    def _ready(self) -> StepFound:
        """The last step. Raises `LrmError` if there is none, or other work goes on."""
        if self.step is None:
            raise LrmError("no model is open yet")
        if self.busy or self._next is not None:
            raise LrmError("still at work; wait, or press Cancel")
        return self.step

    def _did(self, value: StepFound, *words: str | Path) -> None:
        self.law = None
        self.done.append(DoneCommand(words, value.files.effects_file, value.files.reading))

    def _model_and_data(self) -> tuple[Path, Path]:
        files = self.steps[-1].files
        return files.model, files.data

    def _changed(self, drawn: bool = False) -> None:
        self.version += 1
        self.drawn += drawn


def _opened(task: OpenTask, value: StepFound) -> DoneCommand:
    """A fit, or a copy of the model that was opened: steps are taken from that."""
    if task.model is not None:
        return DoneCommand(("compare", value.files.model, task.data), task.effects_file, task.reading)
    words: tuple[str | Path, ...] = ("fit", task.data, "-o", task.kept)
    return DoneCommand(words if task.arm is None else (*words, "--arm", task.arm), None, task.reading)
