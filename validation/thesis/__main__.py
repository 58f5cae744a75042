"""The method of the thesis (Conenna 2024) on any data set: `python -m validation.thesis`."""

from __future__ import annotations

import typer

from lrm_ident.cli.app import run
from lrm_ident.cli.command import command_of
from validation.thesis.options_command import options
from validation.thesis.step_size_command import step_size

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="The method of the thesis (Conenna 2024) on any data set.",
)
for function in (options, step_size):
    command_of(app)(function)


def main() -> None:
    """Runs the command; every expected error is one line on stderr and exit code 2."""
    run(app)


if __name__ == "__main__":
    main()
