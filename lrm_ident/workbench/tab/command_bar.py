"""The bar of the work: what may be done with the model, what is being done, and why something was not."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

from nicegui import ui

from lrm_ident.report.plots.interactive.assets import TOLD
from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.work.tasks import WorkProgress

MISSING, MEASURE = "find out which effect is missing", "what to measure next, to distinguish the candidates"
SAVE = "write the model as a file (S)"
ADD_FIELD = "Add a field (not a cause)"
SURE_AFTER_S = 1.0
"""s of work after which its rate says how long the rest takes."""


class PageAction(NamedTuple):
    """What a person may do: what the button says, the deed or the address of a tab, a hint, the key, what allows it."""

    text: str
    do: Callable[[], object] | str
    hint: str
    key: str = ""
    able: str = ""


Button = Callable[[PageAction], ui.button]


def step_commands(session: WorkbenchSession) -> Iterator[PageAction]:
    """The commands that change the model, and those that look for what is missing."""
    yield PageAction("Auto", session.auto, "add effects as advised until none is left", "", "ready")
    yield PageAction("Diagnose again", session.diagnose, MISSING, "", "can_diagnose")
    yield PageAction("Next poses", session.next_poses, MEASURE, "", "can_choose_poses")
    yield PageAction("Propose a formula", session.propose, "where no known effect explains the error (P)", "p", "ready")
    helps = "predict the remaining error without a name, where that surely helps"
    yield PageAction(ADD_FIELD, session.add_field, helps, "", "ready")
    yield PageAction("Undo", session.undo, "take the last step back (U)", "u", "can_undo")
    yield PageAction("Redo", session.redo, "take it again (R)", "r", "can_redo")


class WorkShown:
    """The work going on, why something failed, and the verdict."""

    def __init__(self, session: WorkbenchSession, button: Button) -> None:
        self.session, self.task, self.begun = session, "", 0.0
        with ui.element("div").classes("lrm-do"):
            ui.html('<span id="lrm-asked" role="status" hidden></span>', sanitize=False)
            with ui.element("div").classes("lrm-work").props('id="lrm-work" aria-live=polite') as self.work:
                self.what = ui.label()
                bar = ui.linear_progress(0.0, show_value=False).classes("lrm-bar-of-work")
                self.bar = bar.props('instant-feedback aria-label="progress"')
                button(PageAction("Cancel", session.cancel, "end this work (Esc)"))
        failure = ui.label().classes("lrm-failure").props('id="lrm-failure" role=alert')
        failure.bind_text_from(session, "failure")
        ui.html(TOLD.format(verdict="", sentence="", facts=""), sanitize=False)

    def show(self) -> None:
        """Shows how far the work is now."""
        progress = self.session.progress
        self.work.set_visibility(progress is not None)
        if progress is not None:
            self.what.set_text(self._words(progress))
            self.bar.set_visibility(progress.of > 0)
            self.bar.set_value(progress.done / progress.of if progress.of else 0.0)

    def _words(self, progress: WorkProgress) -> str:
        """The running task, how far it is, and how long the rest takes at this rate."""
        clock = time.monotonic()
        if progress.what != self.task or progress.done == 0:
            self.task, self.begun = progress.what, clock
        if not progress.of:
            return progress.what
        spent, words = clock - self.begun, f"{progress.what}: {progress.done} of {progress.of}"
        if not progress.done or spent < SURE_AFTER_S:
            return words
        return f"{words}, {max(1.0, spent / progress.done * (progress.of - progress.done)):.0f} s left"


def file_notices(session: WorkbenchSession, button: Button) -> None:
    """Two lines below the bar of one tab, each shown only while there is something to decide."""
    with ui.element("div").classes("lrm-notice").props('id="lrm-stale" role=alert') as stale:
        changed = "{} has changed on disk. What is shown is as it was read."
        ui.label().bind_text_from(session, "step", lambda step: changed.format(step.files.data.name) if step else "")
        button(PageAction("Reload", session.reload, "read the file as it is now; the model stays"))
        button(PageAction("Keep", session.keep, "go on with the measurements as they were read"))
    stale.bind_visibility_from(session, "stale")
    with ui.element("div").classes("lrm-notice").props('id="lrm-offer" role=status') as offer:
        words = "Last session with {0.data.name}: {0.model}"
        ui.label().bind_text_from(session, "offered", lambda files: words.format(files) if files else "")
        button(PageAction("Go on", session.resume, "open the model and the measurements of the last session"))
        button(PageAction("Not now", session.decline, "stay here"))
    offer.bind_visibility_from(
        session, "offered", lambda offer_made: offer_made is not None and len(session.taken.steps) <= 1
    )
