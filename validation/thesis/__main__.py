"""The thesis's commands: `python -m validation.thesis`."""

from __future__ import annotations

from lrm_ident.cli.app import run
from validation.thesis import options_command, step_size_command
from validation.thesis.application import app

__all__ = ["main", "options_command", "step_size_command"]


def main() -> None:
    """Runs the command; every expected error is one line on stderr and exit code 2."""
    run(app)


if __name__ == "__main__":
    main()
