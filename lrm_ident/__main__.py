"""Entry point of `lrm-ident`: the command line, or one line that says what to install."""

from __future__ import annotations

import os
import sys

# Matrices are small here: threads of the linear algebra library cost more than they bring (set before numpy loads).
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

OFFLINE = {"matplotlib", "rich", "scipy", "tomli_w", "typer"}
"""Import names of the packages of the extra `ident`, which a rover does not need."""


def main() -> None:
    """Runs the command line; a missing package of the extra `ident` is one line on stderr and exit code 2."""
    try:
        if sys.argv[1:2] == ["workbench"] and "--help" not in sys.argv:
            from lrm_ident.workbench.work.worker import start_early

            start_early()
        from lrm_ident.cli.app import main as run

        run()
    except KeyboardInterrupt:  # while it loads: a command reports it itself
        print("error: interrupted", file=sys.stderr)
        sys.exit(130)
    except ModuleNotFoundError as error:
        if error.name not in OFFLINE:
            raise
        print(
            f"error: lrm-ident needs the package '{error.name}', which is not installed: pip install 'lrm-arm[ident]'",
            file=sys.stderr,
        )
        sys.exit(2)


if __name__ == "__main__":
    main()
