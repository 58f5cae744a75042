"""The workbench's server: on this machine only, behind a token, with all files that the page needs."""

from __future__ import annotations

import os

from lrm_ident.workbench.address import WorkbenchAddress
from lrm_ident.workbench.last_session import last_session
from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.work.tasks import OpenTask
from lrm_ident.workbench.work.worker import work_process
from lrm_math.errors import LrmError


def serve(place: WorkbenchAddress, opened: OpenTask, tour: bool, show: bool) -> None:
    """Runs the workbench until it is stopped. Raises `LrmError` if NiceGUI is not installed.

    Args:
        tour: whether the first tab begins with the guided tour. show: whether the browser is opened.
    """
    worker = work_process()
    offered = last_session(place.folder, None if tour else opened.data)
    session = WorkbenchSession(place.folder, worker, offered=offered)
    session.open(opened)
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(place.folder / ".page"))
    try:
        from lrm_ident.workbench.application import run_application
    except ModuleNotFoundError as error:
        worker.close()
        raise LrmError(
            f"the workbench needs '{error.name}', which is not installed: pip install 'lrm-arm[page]'"
        ) from None
    try:
        run_application(place, session, tour, show)
    finally:
        worker.close()
        if session.again:
            print(f"Go on with: {session.again}", flush=True)
