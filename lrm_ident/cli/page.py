"""Commands that show what the others compute: the report, the workbench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from lrm_ident.api import EXAMPLE
from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import log, notice, progress, read_inputs, show
from lrm_ident.data.apply_reading import AS_NAMED
from lrm_ident.data.atomic_write import write_text
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.estimation.error_breakdown import compare
from lrm_ident.estimation.priors import prior_of_file
from lrm_ident.page.html_report import html_report
from lrm_ident.page.server import new_place, serve
from lrm_ident.page.tasks import OpenTask
from lrm_ident.workflow.findings import first_look, with_comparison, with_diagnosis
from lrm_ident.workflow.inputs import identifiable
from lrm_math.errors import FileError, LrmError
from lrm_math.model.reading import Reading


@command
def report(
    model: arg.ModelPath,
    data: arg.DataFile,
    output: Annotated[Path, Option("-o", "--output", metavar="REPORT.html", help="Where to write the page.")],
    json: arg.JsonFile = None,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Write one HTML file with everything: the error field, where the model fails, what is missing, the history.

    It holds the results of compare and diagnose, opens without a network, and prints well.
    """
    inputs = read_inputs(model, data, effects_file, reading)
    found = first_look(inputs)
    with progress("held-out error") as tick:
        prior = prior_of_file(inputs.file, inputs.model, inputs.catalogue)
        found = with_comparison(found, compare(inputs.model, inputs.data, tick, prior, inputs.loss))
    inputs = identifiable(inputs, notice)
    with progress("trying every effect at every place") as tick:
        diagnosis = diagnose(inputs.model, inputs.data, inputs.catalogue, tick, inputs.loss)
    with log.status("cross-validating") as status:
        found = with_diagnosis(found, build_report(diagnosis, status.update))
    write_text(output, html_report(found))
    if json:
        write_text(json, found.document().json())
    show(found.verdict, f"Report written to {output}")


@command
def workbench(
    files: Annotated[
        list[Path] | None,
        Argument(metavar="[MODEL] [DATA]", help="A model file, measurements, or both. Neither: the shipped data set."),
    ] = None,
    arm: arg.ArmName = None,
    port: Annotated[int | None, Option(min=1, max=65535, help="Of this machine. Default: a free one.")] = None,
    show_page: Annotated[bool, Option("--open/--no-open", help="Open the page in the browser.")] = True,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Compare, diagnose and extend a model on a page in the browser, on this machine only.

    Without files it opens the shipped data set and shows around. With measurements alone it fits a model first.
    """
    model, data = _model_and_data(files or [])
    place = new_place(port)
    task = OpenTask(data or EXAMPLE, model, arm, effects_file, reading)
    serve(place, task, tour=data is None, show=show_page)


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
