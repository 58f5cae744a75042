"""The page of one tab: header, panels and numbers, redrawn whenever the session has changed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nicegui import ui

from lrm_ident.page.commands import commands_text
from lrm_ident.page.rover_link import RoverLink
from lrm_ident.page.session import WorkbenchSession
from lrm_ident.page.tasks import LawFound
from lrm_ident.page.tour import TOUR
from lrm_ident.plots.interactive.values import rounded
from lrm_ident.report.document import Block, Document
from lrm_ident.report.document_html import blocks_html, table_html
from lrm_math.errors import LrmError

PANELS = Path(__file__).with_name("panels.html")
HEAD = """<link rel="stylesheet" href="/lrm/static/figures.css"><link rel="stylesheet" href="/lrm/page/workbench.css">
<script src="/lrm/static/plotly-gl3d.min.js"></script><script src="/lrm/static/figures.js"></script>
<script src="/lrm/page/workbench.js"></script>
<script>document.documentElement.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
window.lrmEmit = (name, value) => emitEvent(name, value);</script>"""
REFRESH_S, ROVER_S = 0.1, 0.2


@dataclass
class WorkbenchPage:
    """One tab. `chosen`: the candidate chosen in it; `seen`, `drawn`: the versions of the session that it shows."""

    session: WorkbenchSession
    gone: str
    chosen: str | None = None
    seen: int = -1
    drawn: int = -1
    stop: int = -1
    rover: RoverLink | None = None
    law: LawFound | None = None
    parts: dict[str, Any] = field(default_factory=dict)

    # ---- building

    def build(self, first_tab: bool, tour: bool) -> None:
        """Makes the elements. Called within the page."""
        ui.add_head_html(HEAD)
        self.law = self.session.law
        self.parts["dark"] = ui.dark_mode(None)
        self._build_header()
        self._build_work()
        ui.html(PANELS.read_text(encoding="utf-8"), sanitize=False).classes("w-full")
        self.parts["numbers"] = ui.html("", sanitize=False).classes("lrm-numbers")
        self._build_tour()
        ui.on("lrm_choose", lambda event: self._choose(event.args))
        ui.on("lrm_key", lambda event: self._press(event.args))
        ui.timer(REFRESH_S, self.refresh)
        ui.timer(ROVER_S, self._show_rover)
        ui.run_javascript(f"window.lrmGone = {json.dumps(self.gone)}")
        if not first_tab:
            ui.notify("The workbench is open in another tab too: both show the same work.", type="info")
        if tour:
            self._go_to(0)

    def _build_header(self) -> None:
        with ui.element("header").classes("lrm-head"):
            ui.label("lrm-ident workbench").classes("lrm-title")
            self.parts["files"] = ui.label().classes("lrm-files")
            ui.element("div").classes("lrm-grow")
            self._button("Open…", lambda: ui.run_javascript("lrmPick()"), "open a CSV, a model, or both; or drop them")
            self._button("Save…", self._save, "write the model as a file (S)")
            self._button("Report", lambda: ui.run_javascript("window.open('/lrm/report')"), "everything in one file")
            self._button("Commands", self._commands, "what was done, as commands (C)")
            self._button("Live…", self._live, "follow a file that grows, or a rover")
            self._button("Tour", lambda: self._go_to(0), "six steps on the shipped data")
            self._button("◐", self._turn_dark, "light or dark", name="light or dark")

    def _build_work(self) -> None:
        with ui.element("div").classes("lrm-head"):
            parts = self.parts
            parts["add"] = self._button("Add", self._add, "add the chosen effect and refit everything (A)")
            parts["undo"] = self._button("Undo", self._undo, "take the last step back (U)")
            parts["propose"] = self._button("Propose a law", self._propose, "where no known effect fits (P)")
            parts["auto"] = self._button("Auto", self._auto, "follow the advice until it says stop")
            parts["diagnose"] = self._button("Diagnose", self.session.diagnose, "find out what is missing")
            parts["verdict"] = ui.label().classes("lrm-verdict").props('id="lrm-verdict" aria-live=polite')
            ui.element("div").classes("lrm-grow")
            with ui.element("div").classes("lrm-work").props('id="lrm-work" aria-live=polite') as parts["work"]:
                parts["spinner"] = ui.spinner(size="18px")
                parts["what"] = ui.label()
                bar = ui.linear_progress(0.0, show_value=False).classes("w-32")
                parts["bar"] = bar.props("instant-feedback")
                parts["cancel"] = self._button("Cancel", self._cancel, "end this work (Esc)")
            parts["failure"] = ui.label().classes("lrm-failure").props('id="lrm-failure" role=alert')

    def _button(self, text: str, action: Callable[[], object], hint: str, name: str = "") -> ui.button:
        button = ui.button(text, on_click=lambda: self._do(action)).props("no-caps unelevated dense outline")
        button.props(f'aria-label="{name or text}" data-name="{(name or text).lower()}"')
        return button.tooltip(hint)

    # ---- refreshing

    def refresh(self) -> None:
        """Shows the session as it is now, if it has changed."""
        session = self.session
        if self.seen == session.version:
            return
        self.seen = session.version
        self._show_work()
        findings = session.findings
        if findings is not None:
            self.parts["files"].set_text(
                f"{findings.file.arm} · {findings.poses.path.name} · {findings.field.poses} poses"
            )
            self.parts["verdict"].set_text(findings.verdict)
        if session.law is not self.law:
            self.law = session.law
            self._law_dialog()
        if self.drawn != session.drawn and findings is not None:
            self.drawn = session.drawn
            ui.run_javascript(f"lrm.load('/lrm/values?n={session.drawn}')")
            self.parts["numbers"].set_content(self._numbers())
            note = "" if findings.diagnosis else "the candidates appear when every effect has been tried"
            ui.run_javascript(f"document.getElementById('lrm-effect-note').textContent = {json.dumps(note)}")

    def _show_work(self) -> None:
        session, parts = self.session, self.parts
        now = session.progress
        parts["work"].set_visibility(now is not None)
        if now is not None:
            parts["what"].set_text(now.what)
            parts["bar"].set_visibility(now.of > 0)
            parts["bar"].set_value(now.done / now.of if now.of else 0.0)
        parts["failure"].set_text(session.failure)
        ready = session.step is not None and not session.busy
        parts["add"].set_text(f"Add {self.chosen}" if self.chosen else "Add")
        parts["add"].set_enabled(ready and self.chosen is not None)
        parts["undo"].set_enabled(session.can_undo)
        parts["propose"].set_enabled(ready)
        parts["auto"].set_enabled(ready)
        parts["diagnose"].set_visibility(session.can_diagnose)

    def _numbers(self) -> str:
        findings = self.session.findings
        assert findings is not None
        notices = "".join(f"<p>{words}</p>" for words in map(_escaped, self.session.notices))
        law = self.session.law
        sections = [
            ("What to know of the files", notices),
            ("Proposed law", "" if law is None else blocks_html(law.document.blocks)),
            ("What is missing, and what these data cannot show", _html(findings.diagnosis)),
            ("Where it fails", _html(findings.comparison)),
            ("Steps", table_html(findings.history)),
            ("Parameters", table_html(findings.parameters)),
            ("Provenance", table_html(findings.provenance)),
        ]
        return "".join(f"<section><h2>{title}</h2>{text}</section>" for title, text in sections if text)

    # ---- doing

    def _do(self, action: Callable[[], object]) -> None:
        """Does what a button says; why it cannot be done is told."""
        try:
            action()
        except LrmError as error:
            ui.notify(str(error), type="warning", multi_line=True, timeout=8000, close_button="OK")
        self.refresh()

    def _press(self, key: str) -> None:
        actions = {"a": self._add, "u": self._undo, "p": self._propose, "s": self._save, "c": self._commands}
        if key == "escape":
            actions["escape"] = self._cancel if self.session.progress is not None else self._leave_tour
        if key in actions:
            self._do(actions[key])

    def _choose(self, name: str | None) -> None:
        self.chosen = name
        self._show_work()

    def _add(self) -> None:
        if self.chosen is None:
            raise LrmError("choose an effect of the list first")
        self.session.add(self.chosen)

    def _undo(self) -> None:
        self.session.undo()

    def _auto(self) -> None:
        self.session.auto()

    def _cancel(self) -> None:
        self.session.cancel()

    def _propose(self) -> None:
        self.session.propose()

    def _law_dialog(self) -> None:
        """What the search for a law found, and the button that adds it."""
        law = self.session.law
        if law is None:
            return
        with ui.dialog() as dialog, ui.card().classes("w-full max-w-3xl").props('id="lrm-law"'):
            ui.html(blocks_html(law.document.blocks), sanitize=False).classes("lrm-numbers")
            with ui.row():
                if law.file is not None:
                    add = self.session.add_law
                    ui.button("Add the law", on_click=lambda: self._then(dialog, add)).props("no-caps")
                ui.button("Close", on_click=dialog.close).props("no-caps flat data-name=close-law")
            if law.file is not None:
                ui.label(f"Kept in {law.file}: read it, and say what causes it.").classes("lrm-small")
        dialog.open()

    def _save(self) -> None:
        if self.session.step is None:
            raise LrmError("no model is open yet")
        with ui.dialog() as dialog, ui.card().classes("w-full max-w-xl"):
            path = ui.input("Write the model to", value=str(Path.cwd() / "model.toml")).classes("w-full")

            def save() -> None:
                self.session.save(Path(path.value).expanduser())
                dialog.close()
                ui.notify(f"Model written to {path.value}", type="positive")

            with ui.row():
                ui.button("Save", on_click=lambda: self._do(save))
                ui.button("Download", on_click=lambda: ui.run_javascript("window.location = '/lrm/model'"))
                ui.button("Close", on_click=dialog.close)
        dialog.open()

    def _commands(self) -> None:
        text = commands_text(self.session.done)
        with ui.dialog() as dialog, ui.card().classes("w-full max-w-4xl"):
            ui.label("What was done here, as commands")
            ui.label(text).classes("lrm-code w-full").props('id="lrm-commands"')
            with ui.row():
                ui.button("Copy", on_click=lambda: ui.clipboard.write(text))
                ui.button("Close", on_click=dialog.close)
        dialog.open()

    def _then(self, dialog: ui.dialog, action: Callable[[], object]) -> None:
        dialog.close()
        self._do(action)

    def _live(self) -> None:
        with ui.dialog() as dialog, ui.card().classes("w-full max-w-xl"):
            step = self.session.step
            ui.label("A file that is being measured: its rows appear as they are written.").classes("lrm-small")
            path = ui.input("Follow the file", value=str(step.files.data) if step else "").classes("w-full")
            with ui.row():
                start = lambda: self.session.follow(Path(path.value).expanduser())  # noqa: E731
                ui.button("Follow the file", on_click=lambda: self._then(dialog, start)).props("no-caps")
                stop = self.session.stop_following
                ui.button("Stop following", on_click=lambda: self._then(dialog, stop)).props("no-caps flat")
            ui.label("A running lrmd: where its arm is, and where the model thinks the tip is.").classes("lrm-small")
            robot = ui.input("Robot", value="rover").classes("w-full")
            endpoint = ui.input("zenoh endpoint", value="tcp/127.0.0.1:7447").classes("w-full")
            with ui.row():
                listen = lambda: self._listen(robot.value, endpoint.value)  # noqa: E731
                ui.button("Listen to the rover", on_click=lambda: self._then(dialog, listen)).props("no-caps")
                ui.button("Stop listening", on_click=lambda: self._then(dialog, self._hang_up)).props("no-caps flat")
        dialog.open()

    # ---- a running daemon

    def _listen(self, robot: str, endpoint: str) -> None:
        self._hang_up()
        self.rover = RoverLink(robot, endpoint)
        self.rover.start()
        ui.context.client.on_disconnect(self._hang_up)

    def _hang_up(self) -> None:
        if self.rover is not None:
            self.rover.close()
            self.rover = None
            ui.run_javascript("lrm.rover(null)")

    def _show_rover(self) -> None:
        findings, step = self.session.findings, self.session.step
        if self.rover is None or findings is None or step is None:
            return
        try:
            model = self.session.model()
            tip = self.rover.tip(model)
        except LrmError as error:
            ui.run_javascript(f"lrm.rover({json.dumps({'words': str(error)})})")
            return
        told = {"words": tip.words, "nominal": rounded(tip.nominal * 1e3, 2), "bent": rounded(tip.bent * 1e3, 2)}
        ui.run_javascript(f"lrm.rover({json.dumps(told)})")

    def _turn_dark(self) -> None:
        ui.run_javascript(
            "const dark = document.documentElement.dataset.theme !== 'dark'; lrm.theme(dark ? 'dark' : 'light'); "
            "Quasar.Dark.set(dark);"
        )

    # ---- the tour

    def _build_tour(self) -> None:
        with ui.element("aside").classes("lrm-tour").props("role=dialog aria-label=tour") as card:
            title = ui.html("", sanitize=False)
            words = ui.label()
            with ui.row().classes("q-mt-sm"):
                ui.button("Back", on_click=lambda: self._go_to(self.stop - 1)).props("no-caps flat dense")
                ui.button("Next", on_click=lambda: self._go_to(self.stop + 1)).props("no-caps dense data-name=next")
                ui.button("Close", on_click=self._leave_tour).props("no-caps flat dense data-name=close-tour")
        card.set_visibility(False)
        self.parts |= {"tour": card, "tour_title": title, "tour_words": words}

    def _go_to(self, stop: int) -> None:
        if not 0 <= stop < len(TOUR):
            self._leave_tour()
            return
        self.stop = stop
        at = TOUR[stop]
        self.parts["tour_title"].set_content(f"<h2>{at.title}</h2>")
        self.parts["tour_words"].set_text(at.words)
        self.parts["tour"].set_visibility(True)
        ui.run_javascript(f"lrmTour('{at.panel}')")

    def _leave_tour(self) -> None:
        self.parts["tour"].set_visibility(False)
        ui.run_javascript("lrmTour('')")


def _html(part: Document | None) -> str:
    blocks: list[Block] = [] if part is None else list(part.blocks)
    return blocks_html(blocks)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;")
