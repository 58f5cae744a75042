"""Routes of the workbench's page: scripts, values of the figures, the report, the model; and dropped files."""

from __future__ import annotations

import tempfile
from pathlib import Path
from urllib.parse import quote

from fastapi import Request
from fastapi.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from nicegui.app import App
from starlette.datastructures import UploadFile

from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.tab.head import FILES
from lrm_ident.workbench.work.dropped import keep_dropped, task_for
from lrm_math.errors import LrmError

NOTHING_OPEN, NO_POSES = "no model is open yet", "no poses are chosen yet"


def add_routes(app: App, session: WorkbenchSession) -> None:
    """Static files, and the answers of `PageRoutes`."""
    for folder, files in FILES.items():
        for file in files:
            app.add_static_file(local_file=file, url_path=f"{folder}/{file.name}", max_cache_age=0)
    routes = PageRoutes(session)
    for answer in (routes.values, routes.report, routes.model, routes.poses):
        app.add_api_route(f"/lrm/{answer.__name__}", answer, methods=["GET"], response_model=None)
    app.add_api_route("/lrm/drop", routes.drop, methods=["POST"], response_model=None)


class PageRoutes:
    """The answers to what the page fetches."""

    def __init__(self, session: WorkbenchSession) -> None:
        self.session = session

    def values(self) -> Response:
        """The values of the figures, JSON; 404 if nothing is open."""
        shown = self.session.shown
        return _file(shown.values if shown else None, "application/json")

    def report(self) -> Response:
        """The report of the last step; 404 if nothing is open. In a thread of its own, since it loads what computes."""
        step = self.session.step
        if step is None:
            return PlainTextResponse(NOTHING_OPEN, status_code=404)
        from lrm_ident.workbench.html_report import html_report

        return HTMLResponse(html_report(step.report))

    def model(self) -> Response:
        """The model file, to be saved; 404 if nothing is open."""
        shown = self.session.shown
        return _file(shown.model if shown else None, "application/toml", "model.toml")

    def poses(self) -> Response:
        """The next poses, to be saved; 404 if none were chosen."""
        found = self.session.poses
        if found is None:
            return _file(None, "text/csv", missing=NO_POSES)
        return _file(found.table, "text/csv", f"{Path(found.data).stem}-next.csv", NO_POSES)

    async def drop(self, request: Request) -> Response:
        """Opens dropped files; 400 with the reason if they cannot be opened."""
        form = await request.form()
        files = [file for file in form.getlist("files") if isinstance(file, UploadFile)]
        contents = {str(file.filename): await file.read() for file in files}
        session = self.session
        try:
            if session.busy:
                raise LrmError("still at work; wait, or press Cancel, before you open other files")
            folder = Path(tempfile.mkdtemp(prefix="dropped-", dir=session.folder))
            dropped = keep_dropped(folder, contents)
            session.open(task_for(dropped, session.step.files if session.step else None))
        except LrmError as error:
            session.fail(str(error))
            return JSONResponse({"error": str(error)}, status_code=400)
        return JSONResponse({"opened": sorted(contents)})


def _file(text: str | None, kind: str, name: str = "", missing: str = NOTHING_OPEN) -> Response:
    """A text of a media type, to be saved under a name if it has one; 404 and what is missing where there is none."""
    if not text:
        return PlainTextResponse(missing, status_code=404)
    headers = {"content-disposition": f"attachment; filename*=UTF-8''{quote(name)}"} if name else {}
    return Response(text, media_type=kind, headers=headers)
