"""The workbench's server: on this machine only, behind a token, with all files that the page needs."""

from __future__ import annotations

import asyncio
import os
import secrets
import shlex
import socket
import tempfile
import webbrowser
from dataclasses import dataclass
from pathlib import Path

from lrm_ident.page.session import WorkbenchSession
from lrm_ident.page.tasks import OpenTask
from lrm_ident.page.worker import work_process
from lrm_math.errors import LrmError

HOST, TICK_S = "127.0.0.1", 0.03
RECONNECT_S = 30.0
"""s for which a tab's connection may stall before it reloads: drawing without a graphics card can keep it busy."""


@dataclass(frozen=True)
class WorkbenchPlace:
    """Where a workbench runs: `port` of this machine, `token` of its address, `folder` of its steps."""

    port: int
    token: str
    folder: Path

    @property
    def address(self) -> str:
        """What a person opens."""
        return f"http://{HOST}:{self.port}/?token={self.token}"


def new_place(port: int | None) -> WorkbenchPlace:
    """A free place. Raises `LrmError` if the port is taken."""
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            one.bind((HOST, port or 0))
        except OSError as error:
            raise LrmError(f"port {port}: cannot be used ({error.strerror}); choose another with --port") from None
        free = int(one.getsockname()[1])
    return WorkbenchPlace(free, secrets.token_urlsafe(16), Path(tempfile.mkdtemp(prefix="lrm-workbench-")))


def serve(place: WorkbenchPlace, opened: OpenTask, tour: bool, show: bool) -> None:
    """Runs the workbench until it is stopped. Raises `LrmError` if NiceGUI is not installed."""
    worker = work_process()
    session = WorkbenchSession(place.folder, worker)
    session.open(opened)
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(place.folder / ".page"))
    try:
        from nicegui import app, ui
    except ModuleNotFoundError as error:
        worker.close()
        raise LrmError(
            f"the workbench needs '{error.name}', which is not installed: pip install 'lrm-arm[page]'"
        ) from None
    from lrm_ident.page.gate import Gate
    from lrm_ident.page.layout import WorkbenchPage
    from lrm_ident.page.routes import add_routes

    again = shlex.join(["lrm-ident", "workbench", str(opened.data)])
    gone = (
        "The workbench was stopped, or the connection broke. Nothing is lost: every step is a model file in "
        f"{place.folder}. Start it again with: {again} (give it the last of those files as MODEL)."
    )
    tabs: set[str] = set()
    shown_around: list[bool] = []

    @ui.page("/", title="lrm-ident workbench")
    def tab() -> None:
        client = ui.context.client
        client.on_disconnect(lambda: tabs.discard(client.id))
        WorkbenchPage(session, gone).build(first_tab=not tabs, tour=tour and not shown_around)
        tabs.add(client.id)
        shown_around.append(True)

    add_routes(app, session)
    app.add_middleware(Gate, port=place.port, token=place.token)

    async def ticking() -> None:
        while True:
            session.tick()
            await asyncio.sleep(TICK_S)

    running: list[asyncio.Task[None]] = []
    app.on_startup(lambda: running.append(asyncio.create_task(ticking())))
    if show:
        app.on_startup(lambda: webbrowser.open(place.address))
    app.on_startup(
        lambda: print(
            f"Workbench at {place.address}\nEvery step is kept in {place.folder}; Ctrl-C ends it.", flush=True
        )
    )
    try:
        ui.run(
            host=HOST,
            port=place.port,
            show=False,
            reload=False,
            title="lrm-ident workbench",
            favicon="🦾",
            show_welcome_message=False,
            reconnect_timeout=RECONNECT_S,
            tailwind=True,
        )
    finally:
        worker.close()
