"""The page as an application of NiceGUI, which the rest of `lrm_ident` does without."""

from __future__ import annotations

import asyncio
import tempfile
import webbrowser
from pathlib import Path

from fastapi import Request
from fastapi.responses import JSONResponse, PlainTextResponse, Response
from nicegui import app, ui
from starlette.datastructures import UploadFile

from lrm_ident.workbench.address import HOST, WorkbenchAddress
from lrm_ident.workbench.gate import Gate
from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.tab.layout import FILES, WorkbenchPage
from lrm_ident.workbench.work.session_files import keep_dropped, task_for
from lrm_math.errors import LrmError

TITLE, TICK_S = "lrm-ident workbench", 0.03
RECONNECT_S = 30.0
"""s for which a tab's connection may stall before it reloads: a slow machine can be busy for a while."""


def run_application(
    place: WorkbenchAddress, session: WorkbenchSession, motion: tuple[Path, Path] | None, tour: bool, show: bool
) -> None:
    """Serves the page until it is stopped; for the arguments see the command."""
    _add_page(session, tour, motion is not None)
    _add_routes(session, motion)
    app.add_middleware(Gate, port=place.port, token=place.token)
    _when_started(place, session, show)
    ui.run(
        host=HOST,
        port=place.port,
        show=False,
        reload=False,
        title=TITLE,
        favicon="🦾",
        show_welcome_message=False,
        reconnect_timeout=RECONNECT_S,
        tailwind=False,  # its compiler is the largest script of the page, and a few lines of CSS do
        gzip_middleware_factory=None,  # nothing leaves this machine
    )


def _add_page(session: WorkbenchSession, tour: bool, motion: bool) -> None:
    """The page; the first tab of all begins with the tour."""
    tabs: set[str] = set()
    shown_around: list[bool] = []

    @ui.page("/", title=TITLE)
    def tab() -> None:
        """One tab."""
        client = ui.context.client
        client.on_disconnect(lambda: tabs.discard(client.id))
        WorkbenchPage(session, first_tab=not tabs, tour=tour and not shown_around, motion=motion)
        tabs.add(client.id)
        shown_around.append(True)


def _when_started(place: WorkbenchAddress, session: WorkbenchSession, show: bool) -> None:
    """The session goes on; where the page is is printed, and the browser opened, as soon as the server listens."""

    async def ticking() -> None:
        """Takes what comes from the process that works."""
        while True:
            session.tick()
            await asyncio.sleep(TICK_S)

    async def announcing() -> None:
        """Says where the page is, once it can be opened."""
        await place.listening()
        print(f"Workbench at {place.address}\nEvery step is kept in {place.folder}; Ctrl-C ends it.", flush=True)
        if show:
            await asyncio.to_thread(webbrowser.open, place.redirect_file().as_uri())

    running: list[asyncio.Task[None]] = []
    app.on_startup(lambda: running.extend(map(asyncio.create_task, (ticking(), announcing()))))


def _add_routes(session: WorkbenchSession, recorded: tuple[Path, Path] | None) -> None:
    """Static files; what the page fetches, 404 where there is none yet; dropped files."""
    for folder, files in FILES.items():
        for file in files:
            app.add_static_file(local_file=file, url_path=f"{folder}/{file.name}", max_cache_age=0)

    def report() -> Response:
        """The report of the last step, in a thread of its own, since it loads what computes."""
        from lrm_ident.workbench.html_report import html_report

        return _text(html_report(session.step.report) if session.step else None, "text/html")

    def motion() -> Response:
        """The page of motion, in a thread of its own, since it fits; 400 with the reason if it cannot be made."""
        missing = "no motion model is open; give lrm-ident workbench --motion MOTION RECORDING"
        from lrm_ident.workbench.motion_page import page_of_files

        try:
            return _text(page_of_files(*recorded) if recorded else None, "text/html", missing=missing)
        except LrmError as error:
            return PlainTextResponse(str(error), status_code=400)

    async def drop(request: Request) -> Response:
        """Opens dropped files; 400 with the reason if they cannot be opened."""
        files = [file for file in (await request.form()).getlist("files") if isinstance(file, UploadFile)]
        contents = {str(file.filename): await file.read() for file in files}
        try:
            if session.busy:
                raise LrmError("still at work; wait, or press Cancel, before you open other files")
            dropped = keep_dropped(Path(tempfile.mkdtemp(prefix="dropped-", dir=session.folder)), contents)
            session.open(task_for(dropped, session.step.files if session.step else None))
        except LrmError as error:
            session.fail(str(error))
            return JSONResponse({"error": str(error)}, status_code=400)
        return JSONResponse({"opened": sorted(contents)})

    answers = {
        "values": lambda: _text(session.step.values if session.step else None, "application/json"),
        "report": report,
        "motion": motion,
    }
    for name, answer in answers.items():
        app.add_api_route(f"/lrm/{name}", answer, methods=["GET"], response_model=None)
    app.add_api_route("/lrm/drop", drop, methods=["POST"], response_model=None)


def _text(text: str | None, kind: str, missing: str = "no model is open yet") -> Response:
    """A text of a media type; 404 and what is missing where there is none."""
    return Response(text, media_type=kind) if text else PlainTextResponse(missing, status_code=404)
