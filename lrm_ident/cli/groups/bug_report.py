"""The command `report-bug`: what a bug report needs, in a text file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from lrm_ident.cli.command import command
from lrm_ident.cli.common import show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.report.bug_report import bug_report
from lrm_math.errors import FileError


@command
def report_bug(
    files: Annotated[
        list[Path] | None,
        Argument(metavar="[FILES]", help="The files of the command that went wrong: model, data, arm."),
    ] = None,
    output: Annotated[Path, Option("-o", "--output", metavar="FILE", help="Where to write the report.")] = Path(
        "lrm-bug.txt"
    ),
) -> None:
    """Write versions, the last error and the names of your files' columns into a text file. It holds no measurement.

    \b
      lrm-ident report-bug model.toml DATA.csv
      lrm-ident report-bug robot.urdf -o bug.txt
    """
    for missing in (file for file in files or () if not file.exists()):
        raise FileError(missing, "", "no such file", "the files of the command that went wrong, where they are")
    write_text(output, bug_report(files or []))
    show(f"Written to {output}. Read it, then attach it to your report: it holds no measurement.")
