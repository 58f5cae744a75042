"""Arguments of commands: a command that is called wrongly is one line, as every other error."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from lrm_math.errors import LrmError, name_suggestion

INTERRUPTED = 130
"""Exit code of a command that Ctrl-C ended: 128, and the number of SIGINT."""


class OneLineParser(argparse.ArgumentParser):
    """Reports a wrong command line like every other `LrmError`; the beginning of an option's name is no option."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **{"allow_abbrev": False, **options})

    def error(self, message: str) -> NoReturn:
        """Raises `LrmError` instead of printing the usage."""
        raise LrmError(f"{message}; see {self.prog} --help")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Names the nearest choices where there are many. Raises `ArgumentError`: none of the choices."""
        if action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(action, f"unknown '{value}'; {name_suggestion(value, [*action.choices])}")
