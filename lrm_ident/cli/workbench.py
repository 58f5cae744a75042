"""The command that opens the workbench. It loads in a moment: the page's other process loads what computes."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.data.examples import EXAMPLE
from lrm_ident.workbench.address import WorkbenchAddress, last_session, new_place
from lrm_ident.workbench.session import WorkbenchSession
from lrm_ident.workbench.work.tasks import OpenTask
from lrm_ident.workbench.work.worker import work_process
from lrm_math.errors import FileError, LrmError
from lrm_math.model.reading import AS_NAMED, Reading


@command
def workbench(
    files: Annotated[
        list[Path] | None,
        Argument(metavar="[MODEL] [DATA]", help="A model file, measurements, or both. Neither: the shipped data set."),
    ] = None,
    arm: arg.ArmName = None,
    port: Annotated[int | None, Option(min=1, max=65535, help="Port of this machine. Default: a free one.")] = None,
    show_page: Annotated[bool, Option("--open/--no-open", help="Open the page in the browser.")] = True,
    motion: Annotated[
        tuple[Path, Path] | None,
        Option(metavar="MOTION RECORDING", help="A motion model and its recording: what moves show, in a tab beside."),
    ] = None,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Compare, diagnose and extend a model on a page in the browser, on this machine only.

    Without files it opens the shipped data set and shows around. With measurements alone it fits a model first.
    """
    if motion is not None:
        from lrm_math.motion.motion_model import load_motion  # here, since the page would wait for all that it needs

        load_motion(motion[0])
        if not motion[1].exists():
            raise FileError(motion[1], "", "there is no such recording", "a LeRobot dataset, or a log with encoders")
    model, data = _model_and_data(files or [])
    place = new_place(port)
    task = OpenTask(data or EXAMPLE, model, arm, effects_file, reading)
    _serve(place, task, motion, tour=data is None, show=show_page)


def _serve(place: WorkbenchAddress, opened: OpenTask, motion: tuple[Path, Path] | None, tour: bool, show: bool) -> None:
    """Runs the workbench until it is stopped. Raises `LrmError` if NiceGUI is not installed.

    Args:
        motion: model and recording that the page's tab of motion shows.
        tour: whether the first tab begins with the guided tour. show: whether the browser is opened.
    """
    worker = work_process()
    offered = last_session(place.folder, None if tour else opened.data)
    session = WorkbenchSession(place.folder, worker, offered=offered)
    session.open(opened)
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(place.folder / ".page"))
    try:
        from lrm_ident.workbench.application import run_application

        run_application(place, session, motion, tour, show)
    except ModuleNotFoundError as error:
        raise LrmError(
            f"the workbench needs '{error.name}', which is not installed: pip install 'lrm-arm[page]'"
        ) from None
    finally:
        worker.close()
        if session.again:
            print(f"Go on with: {session.again}", flush=True)


def _model_and_data(files: list[Path]) -> tuple[Path | None, Path | None]:
    """The model (.toml) and the measurements (.csv) among some files. Raises `LrmError`."""
    models = [path for path in files if path.suffix == ".toml"]
    data = [path for path in files if path.suffix != ".toml"]
    if len(models) > 1 or len(data) > 1 or (models and not data):
        raise LrmError("give a model (.toml) and measurements (.csv), or measurements alone")
    for path in files:
        if not path.is_file():
            raise FileError(path, "", "no such file")
    return next(iter(models), None), next(iter(data), None)
