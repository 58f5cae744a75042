"""Consoles of the commands: results on stdout, notices and errors on stderr, wrapped at spaces to a known width."""

from __future__ import annotations

import os
from shutil import get_terminal_size

from rich.console import Console

from lrm_math.stdout import flush_or_discard

COLUMNS = get_terminal_size((0, 0)).columns
"""Columns of the terminal, or as the environment's COLUMNS says; 0 where nothing says it, as in a pipe."""


class ResultConsole(Console):
    """A console whose reader may leave, as `head` does: the command goes on and writes its files."""

    def on_broken_pipe(self) -> None:
        """Sends what is still printed nowhere."""
        self.quiet = True
        flush_or_discard()


out = ResultConsole(width=COLUMNS or 100, soft_wrap=not COLUMNS)
log = Console(stderr=True)


def animated() -> bool:
    """Whether bars can move on stderr: on a terminal, but not below a notebook's cell, which keeps all their states."""
    return log.is_terminal and "JPY_PARENT_PID" not in os.environ


def print_error(words: str) -> None:
    """One line on stderr, wrapped at spaces on a terminal."""
    log.print(f"error: {words}", markup=False, highlight=False, soft_wrap=not (COLUMNS or log.is_terminal))
