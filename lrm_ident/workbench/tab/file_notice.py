"""Decisions about files: measurements that changed on disk, and the session before this one."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from lrm_ident.workbench.session import WorkbenchSession


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
