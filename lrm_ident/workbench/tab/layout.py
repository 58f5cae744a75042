"""The page of one tab: header, panels and numbers, redrawn whenever the session has changed."""

from __future__ import annotations

import html
import json
from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from lrm_ident.report.plots.interactive import assets
from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.tab import dialogs
from lrm_ident.workbench.tab.command_bar import ChosenEffect, CommandBar, FileNotice
from lrm_ident.workbench.tab.rover_panel import RoverPanel
from lrm_ident.workbench.work.tasks import section_html
from lrm_math.errors import LrmError

FOLDER = Path(__file__).parent
FILES = {
    "/lrm/static": (assets.LIBRARY, *assets.SCRIPTS, assets.STYLE),
    "/lrm/tab": (FOLDER / "workbench.css", FOLDER / "workbench.js"),
}
"""Files that the page fetches, by their folder in the address."""
BANNER = """<div id="lrm-banner" role="alert" hidden></div>
<section class="lrm-panel lrm-row" id="lrm-rover" hidden aria-label="rover"><h2>Rover</h2>
<div id="lrm-rover-arms" class="lrm-arms"></div><p id="lrm-rover-words" class="lrm-small" aria-live="off"></p>
</section>"""
REFRESH_S, ROVER_S = 0.1, 0.2
SHOWN_MS = 300
"""Until the browser shows the numbers that it was sent."""


def head_html() -> str:
    """HTML of the head. The library of charts is the largest file; nothing waits for it."""
    addresses = [f"{folder}/{file.name}" for folder, files in FILES.items() for file in files]
    styles = "".join(f'<link rel="stylesheet" href="{one}">' for one in addresses if one.endswith(".css"))
    library, *scripts = [one for one in addresses if one.endswith(".js")]
    return f"""{styles}
<script async src="{library}" onload="window.lrm && lrm.ready()"></script>
{"".join(f'<script defer src="{one}"></script>' for one in scripts)}
<script>{assets.PROLOGUE}
document.documentElement.lang = "en";
addEventListener("load", () => Quasar.LoadingBar.setDefaults({{ hijackFilter: () => false }}));
addEventListener("load", () => Quasar.Dark.set(document.documentElement.dataset.theme === "dark"));
window.lrmEmit = (name, value) => emitEvent(name, value);</script>"""


class WorkbenchPage:
    """One tab. `chosen`: the candidate chosen in it; `seen`, `drawn`: the versions of the session that it shows."""

    def __init__(self, session: WorkbenchSession, first_tab: bool, tour: bool, motion: bool) -> None:
        """Makes the elements, within the page; `motion`: there is a tab of motion to open."""
        self.session = session
        self.chosen: ChosenEffect | None = None
        self.seen = self.drawn = -1
        self.law, self.poses = session.taken.law, session.poses
        ui.add_head_html(head_html())
        ui.dark_mode(None)
        self.rover = RoverPanel(session)
        self.bar = CommandBar(session, self._button, self._add, self._save)
        self._build_header(motion)
        self.notice = FileNotice(session, self._button)
        ui.html(BANNER, sanitize=False).classes("lrm-full")
        with ui.element("div").classes("lrm-hero"):
            with ui.element("div").classes("lrm-told"):
                self.bar.build_verdict()
            ui.html(assets.BESIDE, sanitize=False).classes("lrm-contents")
        ui.html(assets.BELOW, sanitize=False).classes("lrm-full")
        self.numbers = ui.html("", sanitize=False).classes("lrm-numbers")
        self.tour = dialogs.TourDialog()
        ui.on("lrm_choose", lambda event: self._choose(event.args))
        ui.on("lrm_key", lambda event: self._press(event.args))
        ui.timer(REFRESH_S, self.refresh)
        ui.timer(ROVER_S, self.rover.show)
        if not first_tab:
            ui.notify("The workbench is open in another tab too: both show the same work.", type="info")
        if tour:
            self.tour.go_to(0)

    def _build_header(self, motion: bool) -> None:
        with ui.element("header").classes("lrm-head"):
            ui.html('<h1 class="lrm-title">lrm-ident workbench</h1>', sanitize=False)
            self.files = ui.label().classes("lrm-files")
            ui.element("div").classes("lrm-grow")
            if motion:
                self._link("Motion", "/lrm/motion", "what moves show, in a tab beside; takes some seconds at first")
            self.bar.build_advice()
            with ui.element("details").classes("lrm-menu").props('id="lrm-menu"'):
                with ui.element("summary"):
                    ui.label("Menu")
                with ui.element("div").classes("lrm-menu-list"):
                    self._button("Open…", lambda: ui.run_javascript("lrmPick()"), "open a CSV, a model, or both")
                    self._button("Save…", self._save, "write the model as a file (S)")
                    self._link("Report", "/lrm/report", "all in one file")
                    self._button("Commands", self._commands, "what was done, as commands (C)")
                    self._button("Live…", self._live, "follow a file that grows, or a rover")
                    ui.element("hr")
                    self.bar.build_menu()
                    ui.element("hr")
                    self._button("Tour", lambda: self.tour.go_to(0), "six steps on the shipped data")
                    theme = "light or dark"
                    self._button("Light or dark", lambda: ui.run_javascript("lrmTurnDark()"), theme, name=theme)

    def _button(self, text: str, action: Callable[[], object], hint: str, name: str = "") -> ui.button:
        button = ui.button(text, on_click=lambda: self._do(action)).props("no-caps unelevated dense outline")
        return button.props(
            f'data-name="{(name or text).lower()}" title="{hint}"' + (f' aria-label="{name}"' if name else "")
        )

    def _link(self, text: str, address: str, hint: str) -> None:
        """A button that opens a tab by itself: browsers block tabs that a script opens after the server's answer."""
        where = f'href="{address}" target="_blank" data-name="{text.lower()}" title="{hint}"'
        ui.button(text).props(f"no-caps unelevated dense outline {where}")

    # ---- refreshing

    def refresh(self) -> None:
        """Shows the session as it is now, if it has changed."""
        session = self.session
        if self.seen == session.version:
            return
        self.seen = session.version
        self.bar.show(self.chosen)
        self.notice.show()
        if session.taken.law is not self.law:
            self.law = session.taken.law
            if self.law is not None:
                dialogs.law_dialog(self.law, session, self._do)
        if session.poses is not self.poses:
            self.poses = session.poses
            if self.poses is not None:
                dialogs.poses_dialog(self.poses)
        shown = session.shown
        if shown is None or self.drawn == session.drawn:
            return
        self.drawn = session.drawn
        self.files.set_text(shown.title)
        ui.run_javascript(f"window.lrmGone = {json.dumps(_gone(session))}")
        ui.run_javascript(f"lrm.load('/lrm/values?n={session.drawn}')")
        self.numbers.set_content(self._numbers(shown.numbers))
        ui.run_javascript(f"setTimeout(() => lrmGlossary(document.querySelector('.lrm-numbers')), {SHOWN_MS})")
        note = "" if shown.diagnosed else "the candidates appear when every effect has been tried"
        ui.run_javascript(f"document.getElementById('lrm-effect-note').textContent = {json.dumps(note)}")

    def _numbers(self, found: str) -> str:
        law = self.session.taken.law
        notices = "".join(f"<p>{html.escape(words)}</p>" for words in self.session.notices)
        notes = section_html("What to know of the files", notices)
        return notes + section_html("Proposed law", "" if law is None else law.words) + found

    # ---- doing

    def _do(self, action: Callable[[], object]) -> None:
        """Does what a button says; shows why it cannot be done."""
        try:
            action()
        except LrmError as error:
            ui.notify(str(error), type="warning", multi_line=True, timeout=8000, close_button="OK")
        self.refresh()
        ui.run_javascript("lrmAnswered()")

    def _press(self, key: str) -> None:
        session = self.session
        actions = {
            "a": self._add,
            "u": session.undo,
            "r": session.redo,
            "p": session.propose,
            "s": self._save,
            "c": self._commands,
        }
        actions["escape"] = session.cancel if session.progress is not None else self.tour.leave
        if key in actions:
            self._do(actions[key])

    def _choose(self, one: dict[str, str] | None) -> None:
        self.chosen = None if one is None else ChosenEffect(one["name"], one["title"])
        self.bar.show(self.chosen)

    def _add(self) -> None:
        if self.chosen is None:
            raise LrmError("choose an effect of the list first")
        self.session.add(self.chosen.name)

    def _save(self) -> None:
        dialogs.save_dialog(self.session, self._do)

    def _live(self) -> None:
        dialogs.live_dialog(self.session, self.rover, self._do)

    def _commands(self) -> None:
        dialogs.commands_dialog(self.session)


def _gone(session: WorkbenchSession) -> str:
    """Words of a tab when the server is gone."""
    return (
        "The workbench was stopped, or the connection broke. Nothing is lost: every step is a model file in "
        f"{session.folder}. Go on with: {session.again}"
    )
