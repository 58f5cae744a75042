"""The page as an application of NiceGUI, which the rest of `lrm_ident` does without."""

from __future__ import annotations

import asyncio
import webbrowser

from nicegui import app, ui

from lrm_ident.workbench.address import HOST, WorkbenchAddress
from lrm_ident.workbench.gate import Gate
from lrm_ident.workbench.routes import add_routes
from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.tab.layout import WorkbenchPage

TITLE, TICK_S = "lrm-ident workbench", 0.03
RECONNECT_S = 30.0
"""s for which a tab's connection may stall before it reloads: a slow machine can be busy for a while."""


def run_application(place: WorkbenchAddress, session: WorkbenchSession, tour: bool, show: bool) -> None:
    """Serves the page until it is stopped; for the arguments see `serve`."""
    _add_page(session, tour)
    add_routes(app, session)
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


def _add_page(session: WorkbenchSession, tour: bool) -> None:
    """The page; the first tab of all begins with the tour."""
    tabs: set[str] = set()
    shown_around: list[bool] = []

    @ui.page("/", title=TITLE)
    def tab() -> None:
        """One tab."""
        client = ui.context.client
        client.on_disconnect(lambda: tabs.discard(client.id))
        WorkbenchPage(session, first_tab=not tabs, tour=tour and not shown_around)
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
            await asyncio.to_thread(webbrowser.open, place.address)

    running: list[asyncio.Task[None]] = []
    app.on_startup(lambda: running.extend(map(asyncio.create_task, (ticking(), announcing()))))
