"""What the workbench's page fetches: scripts, values of the figures, the report, the model; and dropped files."""

from __future__ import annotations

import tempfile
from pathlib import Path

from fastapi import Request
from fastapi.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from nicegui.app import App
from starlette.datastructures import UploadFile

from lrm_ident.estimation.model_history import model_text
from lrm_ident.page.dropped import keep_dropped, task_for
from lrm_ident.page.session import WorkbenchSession
from lrm_ident.plots.interactive import assets
from lrm_ident.plots.interactive.values import figure_values, values_text
from lrm_math.errors import LrmError


def add_routes(app: App, session: WorkbenchSession) -> None:
    """Static files, the figures' values, the report, the model file, and the place that dropped files go to."""
    here = Path(__file__).parent
    for prefix, files in (
        ("/lrm/static", (assets.LIBRARY, assets.SCRIPT, assets.STYLE)),
        ("/lrm/page", (here / "workbench.css", here / "workbench.js")),
    ):
        for file in files:
            app.add_static_file(local_file=file, url_path=f"{prefix}/{file.name}", max_cache_age=0)

    @app.get("/lrm/values")
    def values() -> Response:
        findings = session.findings
        if findings is None:
            return PlainTextResponse("nothing is open yet", status_code=404)
        return Response(values_text(figure_values(findings)), media_type="application/json")

    @app.get("/lrm/report")
    def report() -> Response:
        try:
            return HTMLResponse(session.report())
        except LrmError as error:
            return PlainTextResponse(str(error), status_code=409)

    @app.get("/lrm/model")
    def model() -> Response:
        findings = session.findings
        if findings is None:
            return PlainTextResponse("no model is open yet", status_code=404)
        headers = {"content-disposition": 'attachment; filename="model.toml"'}
        return Response(model_text(findings.file), media_type="application/toml", headers=headers)

    @app.post("/lrm/drop")
    async def drop(request: Request) -> Response:
        form = await request.form()
        files = [file for file in form.getlist("files") if isinstance(file, UploadFile)]
        contents = {str(file.filename): await file.read() for file in files}
        try:
            if session.busy:
                raise LrmError("still at work; wait, or press Cancel, before you open other files")
            folder = Path(tempfile.mkdtemp(prefix="dropped-", dir=session.folder))
            dropped = keep_dropped(folder, contents)
            now = session.step.files if session.step else None
            session.open(task_for(dropped, now))
        except LrmError as error:
            session.fail(str(error))
            return JSONResponse({"error": str(error)}, status_code=400)
        return JSONResponse({"opened": sorted(contents)})
