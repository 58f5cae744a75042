"""State of the workbench that all tabs show: steps, the work going on, and what a person may do next."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from lrm_ident.workbench.taken_steps import DoneCommand, TakenSteps
from lrm_ident.workbench.work.session_files import FollowedFile, OpenedData
from lrm_ident.workbench.work.tasks import (
    DiagnoseTask,
    OpenFiles,
    PosesResult,
    StepResult,
    StepView,
    WorkProgress,
    WorkTask,
)
from lrm_ident.workbench.work.worker import WorkProcess
from lrm_math.errors import LrmError


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
    progress: WorkProgress | None = None
    failure: str = ""
    notices: list[str] = field(default_factory=list)
    followed: FollowedFile | None = None
    offered: OpenFiles | None = None
    opened: OpenedData | None = None
    stale: bool = False
    poses: PosesResult | None = None
    version: int = 0
    drawn: int = 0
    _waiting: WorkTask | None = None
    _at_work: WorkTask | None = None

    @property
    def step(self) -> StepResult | None:
        """The last step."""
        return self.taken.last

    @property
    def shown(self) -> StepView | None:
        """View of the last step."""
        return self.step.shown if self.step else None

    @property
    def busy(self) -> bool:
        """Whether work is going on that a person requested; the diagnosis of a step gives way to it."""
        return self.worker.task is not None and not isinstance(self.worker.task, DiagnoseTask)

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
        if self.step is None:
            return ""
        files = self.step.files
        return DoneCommand(("workbench", files.model, files.data), files.effects_file, files.reading).text

    def fail(self, words: str) -> None:
        """Tells why something could not be done; files that were dropped on the page have the names they came with."""
        self.failure = re.sub(rf"{re.escape(str(self.folder))}/(dropped-\w+/)?", "", words)
        self._changed()

    def _ready(self) -> StepResult:
        """The last step. Raises `LrmError` if there is none, or other work goes on."""
        if self.step is None:
            raise LrmError("no model is open yet")
        if self.busy or self._waiting is not None:
            raise LrmError("still at work; wait, or press Cancel")
        return self.step

    def _changed(self, drawn: bool = False) -> None:
        self.version += 1
        self.drawn += drawn
