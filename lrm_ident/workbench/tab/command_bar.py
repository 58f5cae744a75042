"""The bar of the work: what may be done with the model, what is being done, and why something was not."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from lrm_ident.workbench.session import WorkbenchSession


class CommandBar:
    """Commands of one tab. `button(text, action, hint)` makes a button, `add` adds the effect chosen in the tab."""

    def __init__(
        self,
        session: WorkbenchSession,
        button: Callable[[str, Callable[[], object], str], ui.button],
        add: Callable[[], object],
    ) -> None:
        self.session = session
        with ui.element("div").classes("lrm-head"):
            self.add = button("Add", add, "add the chosen effect and refit everything (A)")
            self.undo = button("Undo", session.undo, "take the last step back (U)")
            self.propose = button("Propose a law", session.propose, "where no known effect fits (P)")
            self.auto = button("Auto", session.auto, "follow the advice until it says stop")
            self.diagnose = button("Diagnose", session.diagnose, "find out what is missing")
            self.verdict = ui.label().classes("lrm-verdict").props('id="lrm-verdict" aria-live=polite')
            ui.element("div").classes("lrm-grow")
            ui.html('<span id="lrm-asked" role="status" hidden></span>', sanitize=False)
            with ui.element("div").classes("lrm-work").props('id="lrm-work" aria-live=polite') as self.work:
                ui.spinner(size="18px")
                self.what = ui.label()
                bar = ui.linear_progress(0.0, show_value=False).classes("lrm-bar-of-work")
                self.bar = bar.props("instant-feedback")
                button("Cancel", session.cancel, "end this work (Esc)")
            self.failure = ui.label().classes("lrm-failure").props('id="lrm-failure" role=alert')

    def show(self, chosen: str | None) -> None:
        """Shows the work going on, and what may be done; `chosen`: the effect that Add would add."""
        session, now = self.session, self.session.progress
        self.work.set_visibility(now is not None)
        if now is not None:
            self.what.set_text(now.what)
            self.bar.set_visibility(now.of > 0)
            self.bar.set_value(now.done / now.of if now.of else 0.0)
        self.failure.set_text(session.failure)
        if session.shown is not None:
            self.verdict.set_text(session.shown.verdict)
        ready = session.step is not None and not session.busy
        self.add.set_text(f"Add {chosen}" if chosen else "Add")
        self.add.set_enabled(ready and chosen is not None)
        self.undo.set_enabled(session.can_undo)
        self.propose.set_enabled(ready)
        self.auto.set_enabled(ready)
        self.diagnose.set_visibility(session.can_diagnose)
