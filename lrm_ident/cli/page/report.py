"""The command that writes the report: what the other commands compute, as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import log, notice, progress, read_inputs, show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.fitting.priors import prior_of_file
from lrm_ident.report.findings import first_look, with_comparison, with_diagnosis
from lrm_ident.residual.error_breakdown import compare
from lrm_ident.study.inputs import identifiable
from lrm_ident.workbench.html_report import html_report
from lrm_math.model.reading import AS_NAMED, Reading


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
