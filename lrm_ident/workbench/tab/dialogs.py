"""The dialogs of the workbench. Each calls back what it is given; `Do` does it, and shows why it cannot be done."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from nicegui import ui

from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.tab.rover_panel import RoverPanel
from lrm_ident.workbench.taken_steps import commands_text
from lrm_ident.workbench.work.tasks import LawResult, PosesResult
from lrm_math.errors import LrmError

Do = Callable[[Callable[[], object]], object]


def law_dialog(law: LawResult, session: WorkbenchSession, do: Do) -> None:
    """Shows what the search for a law found, and the button that adds it."""
    with _dialog("lrm-law", "proposed law", "lrm-wide") as dialog:
        ui.html(law.words, sanitize=False).classes("lrm-numbers")
        with _buttons(dialog, "close-law"):
            if law.file is not None:
                _button("Add the law", lambda: _closing(dialog, do, session.add_law))
        if law.file is not None:
            ui.label(f"Kept in {law.file}: read it, and say what causes it.").classes("lrm-small")


def poses_dialog(poses: PosesResult) -> None:
    """Shows the next poses to measure and offers their file; or says why there are none."""
    title = "No poses were chosen after those of" if poses.problem else "Poses to measure after those of"
    with _dialog("lrm-next-poses", "next poses", "lrm-wide") as dialog:
        ui.label(f"{title} {poses.data}").classes("lrm-verdict")
        with _buttons(dialog, "close-poses"):
            if poses.table:
                _button("Download CSV", lambda: ui.run_javascript("window.location = '/lrm/poses'"))
        if poses.problem:
            ui.label(poses.problem).classes("lrm-failure").props("role=alert")
        ui.html(poses.words, sanitize=False).classes("lrm-numbers")


def save_dialog(session: WorkbenchSession, do: Do) -> None:
    """Asks where to write the model. Raises `LrmError` if there is none."""
    if session.step is None:
        raise LrmError("no model is open yet")
    with _dialog("lrm-save", "save the model") as dialog:
        path = ui.input("Write the model to", value=str(Path.cwd() / "model.toml")).classes("lrm-full")

        def save() -> None:
            session.save(Path(path.value).expanduser())
            dialog.close()
            ui.notify(f"Model written to {path.value}", type="positive")

        with _buttons(dialog):
            _button("Save", lambda: do(save))
            _button("Download", lambda: ui.run_javascript("window.location = '/lrm/model'"))


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
    with _dialog("lrm-live", "live data") as dialog:
        _of_file(session, lambda action: _closing(dialog, do, action))
        _of_rover(rover, dialog, lambda action: _closing(dialog, do, action))


def _of_file(session: WorkbenchSession, do: Do) -> None:
    at_hand = str(session.step.files.data) if session.step else ""
    ui.label("A file that is being measured: its rows appear as they are written.").classes("lrm-small")
    path = ui.input("Follow the file", value=at_hand).classes("lrm-full")
    with ui.row():
        _button("Follow the file", lambda: do(lambda: session.follow(Path(path.value).expanduser())))
        ui.button("Stop following", on_click=lambda: do(session.stop_following)).props("no-caps flat")


def _of_rover(rover: RoverPanel, dialog: ui.dialog, do: Do) -> None:
    ui.label("A running lrmd: where its arm is, and where the model thinks the tip is.").classes("lrm-small")
    robot = ui.input("Robot", value="rover").classes("lrm-full")
    endpoint = ui.input("zenoh endpoint", value="tcp/127.0.0.1:7447").classes("lrm-full")
    with _buttons(dialog):
        _button("Listen to the rover", lambda: do(lambda: rover.listen(robot.value, endpoint.value)))
        ui.button("Stop listening", on_click=lambda: do(rover.hang_up)).props("no-caps flat")


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


def _button(text: str, action: Callable[[], object]) -> ui.button:
    return ui.button(text, on_click=action).props("no-caps unelevated")


def _closing(dialog: ui.dialog, do: Do, action: Callable[[], object]) -> None:
    dialog.close()
    do(action)
