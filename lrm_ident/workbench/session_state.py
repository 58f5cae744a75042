"""State of the workbench that all tabs show: the steps taken, the work going on, and what a person may do next.

What each result of a task adds to the steps are pure functions on values.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from lrm_ident.workbench.work import tasks
from lrm_ident.workbench.work.session_files import FollowedFile, OpenedData
from lrm_ident.workbench.work.worker import WorkProcess
from lrm_math.errors import LrmError


def commands_text(done: Sequence[tasks.DoneCommand]) -> str:
    """One command a line."""
    return "".join(f"{command.text}\n" for command in done)


@dataclass(frozen=True)
class TakenSteps:
    """Steps, the last one being the model, with what was done as commands.

    Attributes:
        law: the last proposed law. count: how many names of files were given away.
        undone: what there was before the last `undo`, which `redo` gives back; None after anything else.
    """

    steps: tuple[tasks.StepResult, ...] = ()
    law: tasks.LawResult | None = None
    done: tuple[tasks.DoneCommand, ...] = ()
    count: int = 0
    undone: TakenSteps | None = None

    @property
    def last(self) -> tasks.StepResult | None:
        """The model, or None if nothing is open."""
        return self.steps[-1] if self.steps else None


def with_step(taken: TakenSteps, task: tasks.WorkTask | None, step: tasks.StepResult) -> TakenSteps:
    """After a task has given a step: a new one, or the last one with more that is known of it."""
    last = taken.last
    if step.command is not None and isinstance(task, tasks.OpenTask):
        return TakenSteps((step,), None, (step.command,), taken.count)
    if step.command is not None:  # one that goes on, as `auto` does, stands once in the list however many steps it took
        goes_on = taken.done[-1].words[:3] == step.command.words[:3]
        done = (*taken.done[: -1 if goes_on else None], step.command)
        count = taken.count + isinstance(task, tasks.AutoTask)
        return replace(taken, steps=(*taken.steps, step), law=None, done=done, count=count, undone=None)
    if isinstance(task, tasks.DiagnoseTask):
        same = last is not None and last.files == step.files
        return replace(taken, steps=(*taken.steps[:-1], step)) if same else taken
    if last is not None and last.files.model == step.files.model:
        same = last.shown.data_sha256 == step.shown.data_sha256
        return replace(taken, steps=(*taken.steps[:-1], step), undone=taken.undone if same else None)
    return replace(taken, steps=(*taken.steps, step))


def without_last(taken: TakenSteps, kept: Path) -> TakenSteps:
    """After `undo`, whose model is kept in a file: the step before is the last one again, if the page knows it."""
    last, earlier, before = taken.steps[-1], taken.steps[:-1], taken
    taken = replace(taken, undone=before)
    done = (*taken.done, tasks.DoneCommand(("undo", last.files.model, "-o", kept)))
    if earlier and earlier[-1].shown.model == last.shown.before:
        known = replace(earlier[-1], files=replace(last.files, model=kept))
        return replace(taken, steps=(*earlier[:-1], known), done=done)
    return replace(taken, steps=earlier, done=done)


def with_undone(taken: TakenSteps) -> TakenSteps:
    """After `redo`: all is as before the last `undo`, but for names of files, which are given away once."""
    return taken if taken.undone is None else replace(taken.undone, count=taken.count)


def with_data(taken: TakenSteps, data: Path) -> TakenSteps:
    """Steps on the same measurements from another file."""
    last = taken.steps[-1]
    return replace(taken, steps=(*taken.steps[:-1], replace(last, files=replace(last.files, data=data))), undone=None)


@dataclass
class SessionState:
    """One person's work on one model, shared by all tabs, as it stands.

    Attributes:
        folder: where every step is kept as a file as soon as it is taken.
        taken: the steps. followed: the growing file that is shown, or None. offered: files of the session before.
        opened: the measurements at hand, as they were read. stale: whether their file has changed since.
        poses: the next poses to measure that were chosen last, or why there are none.
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
    poses: tasks.PosesResult | None = None
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
    def shown(self) -> tasks.StepView | None:
        """View of the last step."""
        return self.step.shown if self.step else None

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
        return self.ready and self.step is not None and self.step.shown.diagnosed

    @property
    def can_diagnose(self) -> bool:
        """Whether the last step has no diagnosis, and none is under way."""
        return self.shown is not None and not self.shown.diagnosed and self.worker.task is None

    @property
    def can_undo(self) -> bool:
        """Whether the model has a step to take back."""
        return not self.busy and self.shown is not None and self.shown.before is not None

    @property
    def can_redo(self) -> bool:
        """Whether a step was taken back that can be had again."""
        return not self.busy and self.taken.undone is not None

    @property
    def again(self) -> str:
        """The command that goes on from here, or "" while nothing is open."""
        return self.step.files.command("workbench").text if self.step else ""

    def fail(self, words: str) -> None:
        """Tells why something could not be done; files that were dropped on the page have the names they came with."""
        self.failure = re.sub(rf"{re.escape(str(self.folder))}/(dropped-\w+/)?", "", words)
        self._changed()

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
