"""The workbench's server: on this machine only, behind a token, with all files that the page needs."""

from __future__ import annotations

import os
import shlex

from lrm_ident.workbench.address import WorkbenchAddress
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
    session = WorkbenchSession(place.folder, worker)
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
        run_application(place, session, _last_words(place, opened), tour, show)
    finally:
        worker.close()


def _last_words(place: WorkbenchAddress, opened: OpenTask) -> str:
    """Words of a tab when the server is gone."""
    again = shlex.join(["lrm-ident", "workbench", str(opened.data)])
    return (
        "The workbench was stopped, or the connection broke. Nothing is lost: every step is a model file in "
        f"{place.folder}. Start it again with: {again} (give it the last of those files as MODEL)."
    )
