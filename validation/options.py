"""Options of a program of this folder, stated by their defaults."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any


def asked(description: str | None, *positional: str, **options: Any) -> argparse.Namespace:
    """The program's options as typed.

    Args:
        description: printed by --help; the docstring of the program.
        positional: names of paths that must be given; with a "?" behind them, may be.
        options: default by name, or (default, help), or (default, help, choices). The type is that of the default; a
            path's default may be None; False is a flag.
    """
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    name = "" if spec is None else spec.name.removesuffix(".__main__")
    parser = argparse.ArgumentParser(prog=f"python -m {name}" if name else None, description=description)
    for place in positional:
        parser.add_argument(place.rstrip("?"), type=Path, nargs="?" if place.endswith("?") else None)
    for option, stated in options.items():
        default, words, choices = (*stated, None, None)[:3] if isinstance(stated, tuple) else (stated, None, None)
        of_type: Any = Path if default is None else type(default)
        how: dict[str, Any] = {"action": "store_true"} if default is False else {"type": of_type, "choices": choices}
        names = (*(("-o",) if option == "out" else ()), f"--{option.replace('_', '-')}")
        parser.add_argument(*names, default=default, help=words, **how)
    return parser.parse_args()
