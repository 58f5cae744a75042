"""`lrm-ident`: every command, and one clear line for every expected error."""

from __future__ import annotations

import sys

from lrm_ident import cli_design, cli_fit, cli_identifiability, cli_method, cli_preliminary, cli_reach, cli_search
from lrm_ident.cli_common import app
from lrm_math.errors import LrmError

__all__ = [
    "cli_design",
    "cli_fit",
    "cli_identifiability",
    "cli_method",
    "cli_preliminary",
    "cli_reach",
    "cli_search",
    "main",
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
