"""Commands to try the tool with: the shipped example as a file of one's own, and its whole story."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

from typer import Exit, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.app import app
from lrm_ident.cli.command import command
from lrm_ident.cli.common import show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.examples import EXAMPLE
from lrm_ident.report.document import heading
from lrm_math.errors import FileError

ExampleFile = Annotated[
    Path,
    Option("-o", "--output", metavar="DATA", help="Where to write the measurements."),
    arg.CompanionFiles({".toml": "metadata"}),
]


@command
def example(output: ExampleFile) -> None:
    """Write the shipped example: 300 simulated poses of a printed arm with one effect hidden in it."""
    _write_example(output)
    show(f"Measurements written to {output}, what is known of them to {output.with_suffix('.toml')}")
    show(f"\nNext: lrm-ident fit {output} -o model.toml")


@command
def demo(
    folder: Annotated[
        Path, Option("-o", "--output", metavar="FOLDER", help="Where to write data, models and report.")
    ] = Path("lrm-demo"),
) -> None:
    """Run the whole story on the shipped example: fit, find the missing effect, add it, see the error fall.

    Each command is printed before it runs, so that it can be copied. It takes half a minute and moves nothing.
    """
    if folder.exists() and not folder.is_dir():
        raise FileError(folder, "", "-o is a file", "name a folder")
    begun = time.monotonic()
    folder.mkdir(parents=True, exist_ok=True)
    data, model, best = (folder / name for name in ("data.csv", "model.toml", "best.toml"))
    _write_example(data)
    for words in (
        ("fit", data, "-o", model, "--force"),
        ("diagnose", model, data),
        ("auto", model, data, "-o", best, "--no-nested", "--force"),
        ("report", best, data, "-o", folder / "report.html"),
    ):
        typed = [str(word) for word in words]
        show(heading(f"\n$ lrm-ident {' '.join(typed)}"))
        if code := app(typed, standalone_mode=False):  # Ctrl-C
            raise Exit(code)
    show(f"\n{time.monotonic() - begun:.0f} s. Open {folder / 'report.html'} in a browser.")


def _write_example(output: Path) -> None:
    write_text(output, EXAMPLE.read_text(encoding="utf-8"))
    write_text(output.with_suffix(".toml"), EXAMPLE.with_suffix(".toml").read_text(encoding="utf-8"))
