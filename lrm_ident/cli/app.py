"""`lrm-ident`: every command, and one clear line for every expected error."""

from __future__ import annotations

import sys

# Commands stand in the help in the order in which their modules are loaded.
from lrm_ident.cli import identifiability, design, fit, thesis, component_tests, workspace, diagnosis, laws  # isort: skip
from lrm_ident.cli.groups import fleet  # isort: skip
from lrm_ident.cli import page, campaign  # isort: skip
from lrm_ident.cli.groups import arm, camera  # isort: skip
from lrm_ident.cli.common import app
from lrm_math.errors import LrmError

__all__ = [
    "app",
    "arm",
    "camera",
    "campaign",
    "component_tests",
    "design",
    "diagnosis",
    "fit",
    "fleet",
    "identifiability",
    "laws",
    "main",
    "page",
    "thesis",
    "workspace",
]


def main() -> None:
    """Entry point: every expected error is one line on stderr and exit code 2."""
    try:
        app()
    except LrmError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
