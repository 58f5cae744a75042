"""The application that every command registers with, and one clear line for every expected error."""

from __future__ import annotations

import sys

import typer

from lrm_math.errors import LrmError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Identify the model of a robot arm from measured TCP positions, see where it fails, find what is missing.\n\n"
    "Start with: lrm-ident fit DATA.csv --arm lrm-lab -o model.toml, then lrm-ident diagnose model.toml DATA.csv",
)


@app.callback()
def group() -> None:
    """Makes it a group of commands even where one is loaded alone."""


def main() -> None:
    """Runs the command of `lrm-ident`."""
    run(app)


def run(application: typer.Typer) -> None:
    """Runs the command; every expected error is one line on stderr and exit code 2."""
    try:
        application()
    except LrmError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
