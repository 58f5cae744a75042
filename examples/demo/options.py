"""Command line of a demo: its seed, and the folder of its files."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path

from lrm_math.command_line import OneLineParser
from lrm_math.errors import LrmError


def run_in_folder(name: str, text: str, run: Callable[[Path, int], None], argv: list[str] | None) -> int:
    """Runs a demo with its folder and seed. Exit code 0, or 2 with one line that says what failed."""
    p = OneLineParser(f"python -m {name}", description=text, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--seed", type=int, help="of what is hidden; drawn and printed if not given")
    p.add_argument("--out", type=Path, default=Path("out"), help="where the files go (default: %(default)s)")
    try:
        options = p.parse_args(argv)
        seed = int.from_bytes(os.urandom(2), "big") if options.seed is None else options.seed
        options.out.mkdir(parents=True, exist_ok=True)
        for old in ("measured.csv", "measured.toml", "measured.camera.toml", "lens.toml"):
            (options.out / old).unlink(missing_ok=True)
        run(options.out, seed)
    except (LrmError, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    return 0
