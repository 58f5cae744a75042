"""The bar of the work: what may be done with the model, what is being done, and why something was not."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

from nicegui import ui

from lrm_ident.report.plots.interactive.assets import TOLD
from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.work.tasks import WorkProgress

ADD_FIELD = "Add a field (not a cause)"
SURE_AFTER_S = 1.0
"""s of work after which its rate says how long the rest takes."""


HINTS = {
    "add": "add the chosen effect and refit everything (A)",
    "diagnose": "find out which effect is missing",
    "next poses": "what to measure next, to distinguish the candidates",
    "save…": "write the model as a file (S)",
}
"""What the advised button does."""


class ChosenEffect(NamedTuple):
    """The effect that Add would add: `effect@place`, and the same in plain words."""

    name: str
    title: str


class CommandBar:
    """Commands of one tab: the one that is advised as a button, all others in a menu.

    `button(text, action, hint)` makes a button, `add` adds the effect chosen in the tab, `save` asks for a file.
    """

    def __init__(
        self,
        session: WorkbenchSession,
        button: Callable[[str, Callable[[], object], str], ui.button],
        add: Callable[[], object],
        save: Callable[[], object],
    ) -> None:
        self.session, self.button = session, button
        self.task, self.begun = "", 0.0
        self.advised: dict[str, Callable[[], object]] = {
            "add": add, "diagnose": session.diagnose, "next poses": session.next_poses, "save…": save
        }  # fmt: skip
        self.first = "diagnose"

    def build_menu(self) -> None:
        """The commands that change the model, and those that look for what is missing."""
        session = self.session
        self.menu = {
            text: self.button(text, action, hint)
            for text, action, hint in (
                ("Auto", session.auto, "add effects as advised until none is left"),
                ("Diagnose again", session.diagnose, HINTS["diagnose"]),
                ("Next poses", session.next_poses, HINTS["next poses"]),
                ("Propose a formula", session.propose, "where no known effect explains the error (P)"),
                (ADD_FIELD, session.add_field, "predict the remaining error without a name, where that surely helps"),
                ("Undo", session.undo, "take the last step back (U)"),
                ("Redo", session.redo, "take it again (R)"),
            )
        }

    def build_advice(self) -> None:
        """The button that is advised; it keeps its place whatever the verdict above the panels says."""
        self.primary = self.button("Diagnose", self._advise, "")
        self.primary.props(remove="outline dense").classes("lrm-primary")
        with self.primary:
            self.name = ui.label().classes("lrm-name-of-effect")

    def build_verdict(self) -> None:
        """The work going on, why something failed, and the verdict."""
        with ui.element("div").classes("lrm-do"):
            ui.html('<span id="lrm-asked" role="status" hidden></span>', sanitize=False)
            with ui.element("div").classes("lrm-work").props('id="lrm-work" aria-live=polite') as self.work:
                self.what = ui.label()
                bar = ui.linear_progress(0.0, show_value=False).classes("lrm-bar-of-work")
                self.bar = bar.props('instant-feedback aria-label="progress"')
                self.button("Cancel", self.session.cancel, "end this work (Esc)")
        self.failure = ui.label().classes("lrm-failure").props('id="lrm-failure" role=alert')
        ui.html(TOLD.format(verdict="", sentence="", facts=""), sanitize=False)

    def _advise(self) -> object:
        return self.advised[self.first]()

    def show(self, chosen: ChosenEffect | None) -> None:
        """Shows the work going on, and what may be done; `chosen`: the effect that Add would add."""
        session, now = self.session, self.session.progress
        self.work.set_visibility(now is not None)
        if now is not None:
            self.what.set_text(self._words(now))
            self.bar.set_visibility(now.of > 0)
            self.bar.set_value(now.done / now.of if now.of else 0.0)
        self.failure.set_text(session.failure)
        ready, shown = session.step is not None and not session.busy, session.shown
        diagnosed = shown is not None and shown.diagnosed
        if chosen is not None:
            self.first, words = "add", f"Add: {chosen.title}"
        elif not diagnosed:
            self.first, words = "diagnose", "Diagnose" if session.can_diagnose else "Diagnosing…"
        else:
            complete = shown is not None and shown.complete
            self.first, words = ("save…", "Save the model…") if complete else ("next poses", "Choose the next poses")
        self.primary.set_text(words)
        self.primary.props(f'data-name="{self.first}" title="{HINTS[self.first]}"')
        self.name.set_text(chosen.name if chosen else "")
        self.primary.set_enabled(session.can_diagnose if self.first == "diagnose" else ready)
        able = {"Undo": session.can_undo, "Redo": session.can_redo, "Diagnose again": session.can_diagnose}
        able["Next poses"] = ready and diagnosed
        for text, button in self.menu.items():
            button.set_enabled(able.get(text, ready))

    def _words(self, now: WorkProgress) -> str:
        """The running task, how far it is, and how long the rest takes at this rate."""
        clock = time.monotonic()
        if now.what != self.task or now.done == 0:
            self.task, self.begun = now.what, clock
        if not now.of:
            return now.what
        spent, words = clock - self.begun, f"{now.what}: {now.done} of {now.of}"
        if not now.done or spent < SURE_AFTER_S:
            return words
        return f"{words}, {max(1.0, spent / now.done * (now.of - now.done)):.0f} s left"


class FileNotice:
    """Two lines below the bar of one tab, each shown only while there is something to decide."""

    def __init__(
        self, session: WorkbenchSession, button: Callable[[str, Callable[[], object], str], ui.button]
    ) -> None:
        self.session = session
        with ui.element("div").classes("lrm-notice").props('id="lrm-stale" role=alert') as self.stale:
            self.words = ui.label()
            button("Reload", session.reload, "read the file as it is now; the model stays")
            button("Keep", session.keep, "go on with the measurements as they were read")
        with ui.element("div").classes("lrm-notice").props('id="lrm-offer" role=status') as self.offer:
            self.last = ui.label()
            button("Go on", session.resume, "open the model and the measurements of the last session")
            button("Not now", self._leave, "stay here")

    def show(self) -> None:
        """Shows what is to be decided now."""
        session = self.session
        self.stale.set_visibility(session.stale)
        if session.step is not None:
            self.words.set_text(f"{session.step.files.data.name} has changed on disk. What is shown is as it was read.")
        self.offer.set_visibility(session.offered is not None and len(session.taken.steps) <= 1)
        if session.offered is not None:
            self.last.set_text(f"Last session with {session.offered.data.name}: {session.offered.model}")

    def _leave(self) -> None:
        self.session.offered = None
        self.show()
