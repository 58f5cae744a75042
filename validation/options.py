"""Options of a program of this folder, stated by their defaults."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from validation.runner import refuse


class Count(int):
    """A number of cases, or of what a case has: one or more."""


def asked(description: str | None, *positional: str, **options: Any) -> argparse.Namespace:
    """The program's options as typed.

    Args:
        description: printed by --help; the docstring of the program.
        positional: names of paths that must be given; with a "?" behind them, may be; with a "+", several.
        options: default by name, or (default, help), or (default, help, choices). The type is that of the default; a
            path's default may be None; False is a flag; a list takes several values, and may be given again, and one
            that holds a type alone is empty. Of a `Count` less than one is refused.
    """
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    name = "" if spec is None else spec.name.removesuffix(".__main__")
    parser = argparse.ArgumentParser(
        prog=f"python -m {name}" if name else None,
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for place in positional:
        parser.add_argument(place.rstrip("?+"), type=Path, nargs=place[-1] if place[-1] in "?+" else None)
    lists: dict[str, list[Any]] = {}
    for option, stated in options.items():
        default, words, choices = (*stated, None, None)[:3] if isinstance(stated, tuple) else (stated, None, None)
        how: dict[str, Any] = {"action": "store_true"} if default is False else {"choices": choices}
        if isinstance(default, list):
            first = default[0]
            how |= {"action": "extend", "nargs": "+", "type": first if isinstance(first, type) else type(first)}
            lists[option], default = [] if isinstance(first, type) else default, None
        elif default is not False:
            how["type"] = Path if default is None or isinstance(default, Path) else type(default)
        names = (*(("-o",) if option == "out" else ()), f"--{option.replace('_', '-')}")
        parser.add_argument(*names, default=default, help=words, **how)
    given = parser.parse_args()
    for option, default in lists.items():  # argparse would extend the default
        if getattr(given, option) is None:
            setattr(given, option, default)
    for option, value in vars(given).items():
        if isinstance(value, Count) and value < 1:
            refuse(f"--{option.replace('_', '-')} is {value}; it takes one or more")
    return given
