"""The application of the thesis's commands, which register as those of `lrm-ident` do."""

from __future__ import annotations

import typer

from lrm_ident.cli.command import command_of

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="The method of the thesis (Conenna 2024) on any data set.",
)
command = command_of(app)
