"""Commands that show a model: its file, and all results on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.app import app
from lrm_ident.cli.command import command, command_of
from lrm_ident.cli.common import identifiable, opened, publish, read_model, show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.fitting.effect_plugins import catalogue_with
from lrm_ident.report.model_report import quick_report, with_comparison, with_diagnosis
from lrm_ident.report.plots.story import draw_story
from lrm_ident.report.story import story_of_file
from lrm_ident.report.summary import summary_document
from lrm_ident.report.text.next_steps import CommandNames
from lrm_ident.workbench.html_report import html_report
from lrm_math.errors import FileError
from lrm_math.model.reading import AS_NAMED, Reading

PAGES = (".html", ".htm")


@command
def report(
    model: arg.ModelPath,
    data: arg.DataFile,
    output: Annotated[Path, Option("-o", "--output", metavar="REPORT.html", help="Where to write the page.")],
    json: arg.JsonFile = None,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Write all results as one HTML page: the error field, where the model fails, what is missing, the history.

    It holds the results of compare and diagnose, opens without a network, and prints well.
    """
    if output.suffix.lower() not in PAGES:
        raise FileError(output, "", f"a page is no {output.suffix or 'nameless'} file", f"name it {PAGES[0]}")
    with opened(model, data, effects_file, reading) as study:
        result = with_comparison(quick_report(study), study.compare())
        names = CommandNames(str(model), str(data), study.file.arm)
        result = with_diagnosis(result, identifiable(study).diagnose(), names)
    write_text(output, html_report(result))
    if json:
        write_text(json, result.document().json())
    told = [] if result.conclusion is None else result.conclusion.blocks()
    show(*told, "", f"Report written to {output}. Open it in a browser; it needs no network.")


@command_of(app, "show")
def show_model(
    model: arg.ModelPath,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
    figure: arg.FigureFile = None,
    effects_file: arg.EffectsFile = None,
) -> None:
    """Show a model file: how the error fell, step by step, and what the model consists of."""
    file, the_model = read_model(model, catalogue_with(effects_file))
    story = story_of_file(file)
    if figure and story is None:
        raise FileError(model, "history", "no nominal error, so the fall of the error cannot be drawn", "fit again")
    publish(
        summary_document(file, the_model),
        json,
        figure,
        None if story is None else lambda path: draw_story(story, path),
        in_full=show_all,
    )
