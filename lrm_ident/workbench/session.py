"""Session of a person with the workbench, without its page: steps that are begun, and what comes back of them."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

from lrm_ident.data.atomic_write import check_outputs, write_text
from lrm_ident.workbench.address import note_session
from lrm_ident.workbench.taken_steps import TakenSteps, with_data, with_step, with_undone, without_last
from lrm_ident.workbench.work import tasks
from lrm_ident.workbench.work.session_files import FollowedFile, OpenedData, follow_file, keep_opened
from lrm_ident.workbench.work.worker import WorkProcess
from lrm_math.errors import LrmError

NOTICES_KEPT, LOOK_S = 8, 0.5
"""Notices on the page; s between two looks at files that may change."""


@dataclass
class WorkbenchSession:
    """One person's work with one model on one set of measurements, shared by all tabs.

    Attributes:
        folder: where every step is kept as a file as soon as it is taken.
        taken: the steps. followed: the growing file that is shown, or None. offered: files of the session before.
        opened: the measurements at hand, as they were read. stale: whether their file has changed since.
        progress: of the work going on, or None. failure: why the last work ended without a result, or "".
        version: grows with every change of the state, `drawn` with every change of what the figures show.
    """

    folder: Path
    worker: WorkProcess
    taken: TakenSteps = field(default_factory=TakenSteps)
    progress: tasks.WorkProgress | None = None
    failure: str = ""
    notices: list[str] = field(default_factory=list)
    followed: FollowedFile | None = None
    offered: tasks.OpenFiles | None = None
    opened: OpenedData | None = None
    stale: bool = False
    version: int = 0
    drawn: int = 0
    _waiting: tasks.WorkTask | None = None
    _at_work: tasks.WorkTask | None = None
    _looked: float = 0.0

    @property
    def step(self) -> tasks.StepResult | None:
        """The last step."""
        return self.taken.last

    @property
    def busy(self) -> bool:
        """Whether work is going on that a person requested; the diagnosis of a step gives way to it."""
        return self.worker.task is not None and not isinstance(self.worker.task, tasks.DiagnoseTask)

    @property
    def ready(self) -> bool:
        """Whether a person may take a step now."""
        return self.step is not None and not self.busy

    @property
    def can_choose_poses(self) -> bool:
        """Whether a diagnosis says what poses are for."""
        return self.ready and self.step is not None and self.step.diagnosed

    @property
    def can_diagnose(self) -> bool:
        """Whether the last step has no diagnosis, and none is under way."""
        return self.step is not None and not self.step.diagnosed and self.worker.task is None

    @property
    def can_undo(self) -> bool:
        """Whether the model has a step to take back."""
        return not self.busy and self.step is not None and self.step.before is not None

    @property
    def can_redo(self) -> bool:
        """Whether a step was taken back that can be had again."""
        return not self.busy and self.taken.undone is not None

    @property
    def again(self) -> str:
        """The command that goes on from here, or "" while nothing is open."""
        return self.step.files.command("workbench").text if self.step else ""

    # ---- what a person does

    def open(self, task: tasks.OpenTask) -> None:
        """Opens files, the model kept here; the steps so far stay as they are until that has worked."""
        self._begin(replace(task, kept=self.new_file()))

    def new_file(self) -> Path:
        """File in which the next step is kept."""
        self.taken = replace(self.taken, count=self.taken.count + 1)
        return self.folder / tasks.kept_name(self.taken.count - 1)

    def add(self, effect: str) -> None:
        """Adds an effect at a place; waits for a diagnosis of this step that is under way, which it needs."""
        step = self._steady()
        self._begin(tasks.AddTask(step.files, step.packed, self.new_file(), effect), waits=True)

    def add_field(self) -> None:
        """Adds what no name explains, where the model predicts better with it; no diagnosis is needed for that."""
        step = self._steady()
        self._begin(tasks.AddTask(step.files, step.packed, self.new_file(), tasks.FIELD))

    def auto(self) -> None:
        """Follows the advice until it says stop."""
        step = self._steady()
        self._begin(tasks.AutoTask(step.files, step.packed, self.folder, self.taken.count))

    def propose(self) -> None:
        """Looks for a law."""
        step = self._steady()
        self._begin(tasks.ProposeTask(step.files, step.packed, self.folder / f"law-{len(self.taken.done)}.py"))

    def next_poses(self) -> None:
        """Chooses the next poses to measure. Raises `LrmError` as long as there is no diagnosis that says what for."""
        step = self._steady()
        if not step.diagnosed:
            raise LrmError("the poses are chosen to tell candidates apart: wait until every effect has been tried")
        kept = self.folder / f"{step.files.data.stem}-{len(self.taken.done)}-next.csv"
        self._begin(tasks.PosesTask(step.files, step.packed, kept))

    def add_law(self) -> None:
        """Adds the proposed law, from its file. Raises `LrmError` if there is none."""
        step = self._steady()
        if self.taken.search_result is None or not self.taken.search_result.effect:
            raise LrmError("no law is proposed; press Propose a formula first")
        if step.files.effects_file is not None:
            raise LrmError("this model has effects of its own already; add the law on the command line")
        files = replace(step.files, effects_file=self.taken.search_result.file)
        self._begin(tasks.AddTask(files, step.packed, self.new_file(), self.taken.search_result.effect))

    def undo(self) -> None:
        """Takes the last step back, exactly. Raises `LrmError` if there is none."""
        step = self._ready()
        if step.before is None:
            raise LrmError("nothing to undo: the model's history has no step before this one")
        self._give_way()
        kept = self.new_file()
        write_text(kept, step.before)
        self.taken = without_last(self.taken, kept)
        self._noted()
        if self.step is not None and self.step.files.model == kept:
            self._diagnose()
        else:
            self._begin(tasks.CompareTask(replace(step.files, model=kept)))

    def redo(self) -> None:
        """Takes a step again that was taken back. Raises `LrmError` if there is none."""
        self._ready()
        if self.taken.undone is None:
            raise LrmError("nothing to redo: no step was taken back since the last change")
        self._give_way()
        self.taken = with_undone(self.taken)
        self._noted()
        self._diagnose()

    def reload(self) -> None:
        """Goes on with the measurements as their file is now."""
        step = self._ready()
        self.opened, self.stale = None, False
        self._begin(tasks.CompareTask(step.files))

    def keep(self) -> None:
        """Goes on with the measurements as they were read. Raises `LrmError` if there is no copy of these."""
        step = self._ready()
        if self.opened is None or self.opened.copy is None:
            raise LrmError(f"{step.files.data} changed while it was read: press Reload")
        self.taken = with_data(self.taken, self.opened.copy)
        self.opened, self.stale = replace(self.opened, path=self.opened.copy), False
        self._noted()
        self._diagnose()

    def resume(self) -> None:
        """Opens the files of the session before. Raises `LrmError` if there are none."""
        if self.offered is None:
            raise LrmError("there is no session before this one")
        files, self.offered = self.offered, None
        self.open(tasks.OpenTask(files.data, files.model, None, files.effects_file, files.reading))

    def decline(self) -> None:
        """Leaves the session before."""
        self.offered = None

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
        self._steady()
        self._diagnose()

    def cancel(self) -> None:
        """Ends the work; steps that are taken stay."""
        what = self.progress.what if self.progress else "the work"
        self.worker.cancel()
        self._waiting, self.progress = None, None
        self.failure = f"cancelled: {what}; the model is as it was after its last step"
        self._changed()

    def save(self, path: Path) -> None:
        """Writes the model, with the checks of the commands. Raises `FileError`."""
        step = self._ready()
        check_outputs({"the model": path}, [step.files.data])
        write_text(path, step.model)

    # ---- what comes back

    def fail(self, words: str) -> None:
        """Tells why something could not be done; files that were dropped on the page have the names they came with."""
        self.failure = re.sub(rf"{re.escape(str(self.folder))}/(dropped-\w+/)?", "", words)
        self._changed()

    def tick(self) -> None:
        """Takes what has come from the process; begins what waits."""
        for message in self.worker.messages():
            self._take(message)
        if self.worker.task is None and self._waiting is not None:
            task, self._waiting = self._waiting, None
            if isinstance(task, tasks.AddTask) and self.step is not None:
                task = replace(task, packed=self.step.packed)  # with the diagnosis that it has waited for
            self._begin(task)
        if time.monotonic() - self._looked > LOOK_S:
            self._look_at_files()

    def _take(self, message: tasks.WorkMessage) -> None:
        if isinstance(message, tasks.WorkProgress):
            self.progress = message
        elif isinstance(message, tasks.WorkNotice):
            if message.words not in self.notices:
                self.notices = [*self.notices, message.words][-NOTICES_KEPT:]
        elif isinstance(message, tasks.StepResult):
            self.taken = with_step(self.taken, self._at_work, message)
            self._noted()
        elif isinstance(message, tasks.SearchResult):
            done = (*self.taken.done, *([message.command] if message.command else []))
            self.taken = replace(self.taken, search_result=message, done=done)
            self._noted()
        elif isinstance(message, tasks.WorkDone):
            self.progress = None
            if message.failure:
                self.fail(message.failure)
            tried = message.failure and isinstance(self._at_work, tasks.DiagnoseTask)
            if self._waiting is None and not tried:
                self._diagnose()
        self._changed()

    # ---- inside

    def _begin(self, task: tasks.WorkTask, waits: bool = False) -> None:
        """Starts a task now, or after the one at work; `waits`: also after a diagnosis under way."""
        if not waits:
            self._give_way()
        if not isinstance(task, tasks.DiagnoseTask):
            self.failure = ""
        if self.worker.task is not None:
            self._waiting = task
        else:
            self._at_work = task
            self.worker.start(task)
        if not isinstance(task, tasks.DiagnoseTask) or self.progress is None:
            self.progress = tasks.WorkProgress("starting")
        self._changed()

    def _noted(self) -> None:
        """Notes what is open now, for a session to come, and watches the file of its measurements."""
        step = self.step
        if step is not None:
            files, sha256 = step.files, step.data_sha256
            note_session(self.folder, files)
            if self.opened is None or (self.opened.path, self.opened.sha256) != (files.data, sha256):
                self.opened = keep_opened(files.data, sha256, self.folder)
        self._changed(drawn=True)

    def _look_at_files(self) -> None:
        """Notices that the file of the measurements is no longer what was read, or that the one followed has grown."""
        self._looked = time.monotonic()
        try:
            if self.followed is None and self.opened is not None and not self.busy:
                if self.stale != (stale := self.opened.changed):
                    self.stale = stale
                    self._changed()
            elif self.followed and self.step and self.worker.task is None and self.followed.grown():
                self._begin(tasks.CompareTask(replace(self.step.files, data=self.followed.copy)))
        except LrmError as error:
            self.followed = None
            self.fail(str(error))

    def _diagnose(self) -> None:
        step = self.step
        waits = step is not None and not step.diagnosed and not self.stale
        if step is not None and waits and self.followed is None and self.worker.task is None:
            self._begin(tasks.DiagnoseTask(step.files, step.packed))

    def _give_way(self) -> None:
        """Ends a diagnosis under way that nobody waits for."""
        if isinstance(self.worker.task, tasks.DiagnoseTask):
            self.worker.cancel()

    def _steady(self) -> tasks.StepResult:
        """The last step, on measurements that are still what was read. Raises `LrmError`."""
        step = self._ready()
        self._look_at_files()
        if self.stale:
            raise LrmError(f"{step.files.data.name} has changed on disk: press Reload or Keep first")
        return step

    def _ready(self) -> tasks.StepResult:
        """The last step. Raises `LrmError` if there is none, or other work goes on."""
        if self.step is None:
            raise LrmError("no model is open yet")
        if self.busy or self._waiting is not None:
            raise LrmError("still at work; wait, or press Cancel")
        return self.step

    def _changed(self, drawn: bool = False) -> None:
        self.version += 1
        self.drawn += drawn
