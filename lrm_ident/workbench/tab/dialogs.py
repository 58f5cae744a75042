"""The dialogs of the workbench and the card of its tour.

Each dialog calls back what it is given; `Do` does it, or shows why it cannot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from nicegui import ui

from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.tab.rover_panel import RoverPanel
from lrm_ident.workbench.taken_steps import commands_text
from lrm_ident.workbench.work.tasks import SearchResult
from lrm_math.errors import LrmError

Do = Callable[[Callable[[], object]], object]
TOUR_BUTTONS = (
    ("Back", "flat", "lrmTour.stop - 1"),
    ("Next", "data-name=next", "lrmTour.stop + 1"),
    ("Close", "flat data-name=close-tour", "-1"),
)
"""What they say, how they look, and the stop that they go to."""


def search_dialog(result: SearchResult, session: WorkbenchSession, do: Do) -> None:
    """Shows what a search found and offers its file, and the button that adds a law; or says why there is nothing."""
    with _dialog("lrm-search", "result of the search", "lrm-wide") as dialog:
        ui.label(result.sentence).classes("lrm-verdict text-weight-bold")
        ui.html('<div id="lrm-next-arms" class="lrm-arms"></div>', sanitize=False)
        with _buttons(dialog, "close-search"):
            if result.effect:
                _button("Add the law", lambda: _closing(dialog, do, session.add_law))
            if result.file is not None:
                _button("Download", partial(ui.download.file, result.file))
        if result.effect:
            ui.label(f"Kept in {result.file}: read it, and say what causes it.").classes("lrm-small")
        if result.problem:
            ui.label(result.problem).classes("lrm-failure").props("role=alert")
        ui.html(result.words, sanitize=False).classes("lrm-numbers")
        ui.run_javascript(f"setTimeout(() => lrm.nextPoses({result.arms}))")


def save_dialog(session: WorkbenchSession, do: Do) -> None:
    """Asks where to write the model. Raises `LrmError` if there is none."""
    if session.step is None:
        raise LrmError("no model is open yet")
    model = session.step.model
    with _dialog("lrm-save", "save the model") as dialog:
        proposed = Path.cwd() / f"{session.step.files.data.stem}-best.toml"
        path = ui.input("Write the model to", value=str(proposed)).classes("lrm-full")
        replaces = ui.checkbox("Replace the file that is there").props('id="lrm-replace"')
        replaces.bind_visibility_from(path, "value", backward=lambda name: Path(name).expanduser().is_file())

        def save() -> None:
            """Writes it. Raises `LrmError` if a file is there that may not be replaced."""
            to = Path(path.value).expanduser()
            if to.is_file() and not replaces.value:
                raise LrmError(f"{to} is there already: mark *Replace the file that is there*, or give another name")
            session.save(to)
            dialog.close()
            ui.notify(f"Model written to {path.value}", type="positive")

        with _buttons(dialog):
            _button("Save", lambda: do(save))
            _button("Download", lambda: ui.download.content(model, "model.toml"))


def commands_dialog(session: WorkbenchSession) -> None:
    """Shows the steps as commands."""
    text = commands_text(session.taken.done)
    with _dialog("lrm-done", "commands", "lrm-wide") as dialog:
        ui.label("What was done here, as commands")
        ui.label(text).classes("lrm-code lrm-full").props('id="lrm-commands" tabindex=0')
        with _buttons(dialog):
            _button("Copy", lambda: ui.clipboard.write(text))


def live_dialog(session: WorkbenchSession, rover: RoverPanel, do: Do) -> None:
    """A file that grows, or a daemon, to be followed."""
    at_hand = str(session.step.files.data) if session.step else ""
    with _dialog("lrm-live", "live data") as dialog:
        ui.label("A file that is being measured: its rows appear as they are written.").classes("lrm-small")
        path = ui.input("Follow the file", value=at_hand).classes("lrm-full")
        with ui.row():
            follow = partial(_closing, dialog, do, lambda: session.follow(Path(path.value).expanduser()))
            _button("Follow the file", follow)
            _button("Stop following", partial(_closing, dialog, do, session.stop_following), "flat")
        ui.label("A running daemon (lrmd): its arm, and where the model thinks the tip is.").classes("lrm-small")
        robot = ui.input("Robot", value="rover").classes("lrm-full")
        endpoint = ui.input("zenoh endpoint", value="tcp/127.0.0.1:7447").classes("lrm-full")
        with _buttons(dialog):
            listen = partial(_closing, dialog, do, lambda: rover.listen(robot.value, endpoint.value))
            _button("Listen to the rover", listen)
            _button("Stop listening", partial(_closing, dialog, do, rover.hang_up), "flat")


@contextmanager
def _dialog(name: str, title: str, classes: str = "") -> Iterator[ui.dialog]:
    """A dialog with a card in it, opened once it is filled. `title`: what a screen reader says of it."""
    dialog = ui.dialog().props(f'aria-label="{title}"')
    with dialog, ui.card().classes(f"lrm-card {classes}").props(f'id="{name}"'):
        yield dialog
    dialog.open()


@contextmanager
def _buttons(dialog: ui.dialog, close: str = "") -> Iterator[None]:
    """A row of buttons, the last of which closes the dialog; `close`: its name."""
    with ui.row():
        yield
        ui.button("Close", on_click=dialog.close).props("no-caps flat" + (f" data-name={close}" if close else ""))


def _button(text: str, action: Callable[[], object], look: str = "unelevated") -> ui.button:
    return ui.button(text, on_click=action).props(f"no-caps {look}")


def _closing(dialog: ui.dialog, do: Do, action: Callable[[], object]) -> None:
    dialog.close()
    do(action)


def tour_card() -> None:
    """A card in the corner that says what the marked panel shows; `lrmTour` of the page's script goes to its stops."""
    with ui.element("section").classes("lrm-tour").props("role=dialog aria-label=tour hidden"):
        ui.html(Path(__file__).with_name("tour.html").read_text(encoding="utf-8"), sanitize=False)
        with ui.row().classes("q-mt-sm"):
            for text, look, stop in TOUR_BUTTONS:
                ui.button(text).props(f"no-caps dense {look}").on("click", js_handler=f"() => lrmTour({stop})")
