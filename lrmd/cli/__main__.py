"""Entry point of `lrm`: the command line, or one line where Ctrl-C comes while it loads."""

from __future__ import annotations

import sys

from lrm_math.command_line import INTERRUPTED


def main(argv: list[str] | None = None) -> int:
    """Runs one command (`lrmd.cli.app.main`); exit code 130 after Ctrl-C."""
    try:
        from lrmd.cli.app import main as run

        return run(argv)
    except KeyboardInterrupt:  # while it loads: a command reports it itself
        print("lrm: interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
