"""The page of one tab: header, panels and numbers, redrawn whenever the session has changed."""

from __future__ import annotations

import html
import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from nicegui import ui

from lrm_ident.report.plots.interactive import assets
from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.tab import dialogs
from lrm_ident.workbench.tab.command_bar import (
    MEASURE,
    MISSING,
    SAVE,
    PageAction,
    WorkShown,
    file_notices,
    step_commands,
)
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
<input type="file" id="lrm-pick" multiple accept=".csv,.toml" onchange="lrmOpen(this.files); this.value = ''" hidden>
<section class="lrm-panel lrm-row" id="lrm-rover" hidden aria-label="rover"><h2>Rover</h2>
<div id="lrm-rover-arms" class="lrm-arms"></div><p id="lrm-rover-words" class="lrm-small" aria-live="off"></p>
</section>"""
GONE = """The workbench was stopped, or the connection broke. Nothing is lost: every step is a model file in {folder}. \
Go on with: {again}"""
BEGIN_TOUR, END_TOUR = "lrmTour(0)", "lrmTour(-1)"
PICK = "document.getElementById('lrm-pick').click()"
REFRESH_S, ROVER_S = 0.1, 0.2
SHOWN_MS = 300
"""Until the browser shows the numbers that it was sent."""


def head_html() -> str:
    """HTML of the head. The library of charts is the largest file; nothing waits for it."""
    addresses = [f"{folder}/{file.name}" for folder, files in FILES.items() for file in files]
    styles = "".join(f'<link rel="stylesheet" href="{address}">' for address in addresses if address.endswith(".css"))
    library, *scripts = [address for address in addresses if address.endswith(".js")]
    return f"""{styles}
<script async src="{library}" onload="window.lrm && lrm.ready()"></script>
{"".join(f'<script defer src="{script}"></script>' for script in scripts)}
<script>{assets.PROLOGUE}
document.documentElement.lang = "en";
addEventListener("load", () => Quasar.LoadingBar.setDefaults({{ hijackFilter: () => false }}));
addEventListener("load", () => Quasar.Dark.set(document.documentElement.dataset.theme === "dark"));
window.lrmEmit = (name, value) => emitEvent(name, value);</script>"""


class WorkbenchPage:
    """One tab. `chosen`: `name`, `title` of the candidate; `seen`, `drawn`: versions of the session that it shows."""

    def __init__(self, session: WorkbenchSession, first_tab: bool, tour: bool, motion: bool) -> None:
        """Makes the elements, within the page; `motion`: there is a tab of motion to open."""
        self.session = session
        self.chosen: dict[str, str] | None = None
        self.seen = self.drawn = -1
        self.search_result = session.taken.search_result
        ui.add_head_html(head_html())
        ui.dark_mode(None)
        self.rover = RoverPanel(session)
        self._build_header(motion)
        file_notices(session, self._button)
        ui.html(BANNER, sanitize=False).classes("lrm-full")
        with ui.element("div").classes("lrm-hero"):
            with ui.element("div").classes("lrm-told"):
                self.work = WorkShown(session, self._button)
            ui.html(assets.BESIDE, sanitize=False).classes("lrm-contents")
        ui.html(assets.BELOW, sanitize=False).classes("lrm-full")
        self.numbers = ui.html("", sanitize=False).classes("lrm-numbers")
        dialogs.tour_card()
        ui.on("lrm_choose", lambda event: self._choose(event.args))
        ui.on("lrm_key", lambda event: self._press(event.args))
        ui.timer(REFRESH_S, self.refresh)
        ui.timer(ROVER_S, self.rover.show)
        if not first_tab:
            ui.notify("The workbench is open in another tab too: both show the same work.", type="info")
        if tour:
            ui.run_javascript(BEGIN_TOUR)

    def _build_header(self, motion: bool) -> None:
        moves = "what moves show, in a tab beside; takes some seconds at first"
        with ui.element("header").classes("lrm-head"):
            ui.html('<h1 class="lrm-title">lrm-ident workbench</h1>', sanitize=False)
            self.files = ui.label().classes("lrm-files")
            ui.element("div").classes("lrm-grow")
            if motion:
                self._button(PageAction("Motion", "/lrm/motion", moves))
            self.primary = ui.button(on_click=lambda: self._press("advised")).props("no-caps unelevated")
            with self.primary.classes("lrm-primary"):
                self.name = ui.label().classes("lrm-name-of-effect")
            with ui.element("details").classes("lrm-menu").props('id="lrm-menu"'):
                with ui.element("summary"):
                    ui.label("Menu")
                with ui.element("div").classes("lrm-menu-list"):
                    for action in self._menu():
                        if action is None:
                            ui.element("hr")
                        else:
                            with self._button(action):
                                ui.label(action.hint)

    def _menu(self) -> Iterator[PageAction | None]:
        """All that may be done but what is advised; None: a line between."""
        yield PageAction("Open…", lambda: ui.run_javascript(PICK), "open a CSV, a model, or both")
        yield PageAction("Save…", self._save, SAVE, "s")
        yield PageAction("Report", "/lrm/report", "all in one file")
        yield PageAction(
            "Commands", lambda: dialogs.commands_dialog(self.session), "what was done, as commands (C)", "c"
        )
        live = partial(dialogs.live_dialog, self.session, self.rover, self._do)
        yield PageAction("Live…", live, "follow a file that grows, or a rover")
        yield None
        yield from step_commands(self.session)
        yield None
        yield PageAction("Tour", lambda: ui.run_javascript(BEGIN_TOUR), "six steps on the shipped data")
        yield PageAction("Light or dark", lambda: ui.run_javascript("lrmTurnDark()"), "the colours of this page")

    def _advised(self) -> tuple[str, PageAction]:
        """What the primary button does now, by its name: Add, as soon as an effect is chosen."""
        session, step = self.session, self.session.step
        if self.chosen is not None:
            add = "add the chosen effect and refit everything (A)"
            return "add", PageAction(f"Add: {self.chosen['title']}", self._add, add, "a", "ready")
        if step is None or not step.diagnosed:
            words = "Diagnose" if session.can_diagnose else "Diagnosing…"
            return "diagnose", PageAction(words, session.diagnose, MISSING, "", "can_diagnose")
        if step.complete:
            return "save…", PageAction("Save the model…", self._save, SAVE, "s", "ready")
        return "next poses", PageAction("Choose the next poses", session.next_poses, MEASURE, "", "ready")

    def _show_advised(self) -> None:
        name, action = self._advised()
        self.primary.set_text(action.text)
        self.primary.props(f'data-name="{name}" title="{action.hint}"')
        self.primary.set_enabled(getattr(self.session, action.able))
        self.name.set_text(self.chosen["name"] if self.chosen else "")

    def _button(self, action: PageAction) -> ui.button:
        """A button; an address opens by itself: browsers block tabs that a script opens after the server's answer."""
        link, do = (f' href="{action.do}" target="_blank"', None) if isinstance(action.do, str) else ("", action.do)
        button = ui.button(action.text, on_click=None if do is None else lambda: self._do(do))
        button.props(f'no-caps unelevated dense outline data-name="{action.text.lower()}" title="{action.hint}"{link}')
        return button.bind_enabled_from(self.session, action.able) if action.able else button

    # ---- refreshing

    def refresh(self) -> None:
        """Shows the session as it is now, if it has changed."""
        session = self.session
        if self.seen == session.version:
            return
        self.seen = session.version
        self.work.show()
        self._show_advised()
        if session.taken.search_result is not self.search_result:
            self.search_result = session.taken.search_result
            if self.search_result is not None:
                dialogs.search_dialog(self.search_result, session, self._do)
        step = session.step
        if step is None or self.drawn == session.drawn:
            return
        self.drawn = session.drawn
        self.files.set_text(step.title)
        gone = GONE.format(folder=session.folder, again=session.again)
        ui.run_javascript(f"window.lrmGone = {json.dumps(gone)}")
        ui.run_javascript(f"lrm.load('/lrm/values?n={session.drawn}')")
        self.numbers.set_content(self._numbers(step.numbers))
        ui.run_javascript(f"setTimeout(() => lrmGlossary(document.querySelector('.lrm-numbers')), {SHOWN_MS})")

    def _numbers(self, numbers: str) -> str:
        last = self.session.taken.search_result
        notices = "".join(f"<p>{html.escape(words)}</p>" for words in self.session.notices)
        notes = section_html("What to know of the files", notices)
        return notes + ("" if last is None else section_html(html.escape(last.sentence), last.words)) + numbers

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
        deeds = {action.key: action.do for action in self._menu() if action} | {
            "a": self._add,
            "advised": self._advised()[1].do,
        }
        deeds["escape"] = session.cancel if session.progress is not None else lambda: ui.run_javascript(END_TOUR)
        if callable(do := deeds.get(key)):
            self._do(do)

    def _choose(self, choice: dict[str, str] | None) -> None:
        self.chosen = choice
        self._show_advised()

    def _add(self) -> None:
        if self.chosen is None:
            raise LrmError("choose an effect of the list first")
        self.session.add(self.chosen["name"])

    def _save(self) -> None:
        dialogs.save_dialog(self.session, self._do)
