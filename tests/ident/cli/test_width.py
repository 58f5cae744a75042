"""Width of output: as wide as the terminal, or as COLUMNS says, and breaks at spaces."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from lrm_ident.cli import consoles
from tests.conftest import EXAMPLE, ROOT


def printed(columns: int | None, *words: object, cwd: Path) -> str:
    """Stdout of `lrm-ident WORDS` in a pipe; it must succeed."""
    done = piped(columns, *words, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


def piped(columns: int | None, *words: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """`lrm-ident WORDS`, run to its end in a pipe."""
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"} | {"PYTHONPATH": str(ROOT)}
    if columns is not None:
        environment["COLUMNS"] = str(columns)
    command = [sys.executable, "-m", "lrm_ident", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=environment)


def words_of(text: str) -> list[str]:
    """Words and numbers, without the lines of tables."""
    return sorted(word for word in text.split() if word.strip("─"))


@pytest.mark.parametrize("command", ["fit", "design", "arm", "reach"])
def test_help_is_wrapped_at_spaces(command: str, tmp_path: Path) -> None:
    wide, narrow = (printed(columns, command, "--help", cwd=tmp_path) for columns in (110, 80))
    assert all(len(line) <= 80 for line in narrow.splitlines())
    assert words_of(narrow) == words_of(wide)


@pytest.mark.parametrize("columns", [80, 100])
def test_results_are_wrapped_at_spaces_where_a_width_is_known(columns: int, tmp_path: Path) -> None:
    fit = ("fit", EXAMPLE, "-o", "model.toml")
    free, narrow = printed(None, *fit, cwd=tmp_path), printed(columns, *fit, cwd=tmp_path)
    assert all(len(line) <= columns for line in narrow.splitlines())
    assert words_of(narrow) == words_of(free)
    assert max(map(len, free.splitlines())) > 100, "in a pipe a sentence is one line"


@pytest.mark.parametrize(
    ("command", "faults"),
    [
        ("frobnicate", ["no such command 'frobnicate'", "COMMAND [ARGS]..., see "]),
        ("diagnose --figures why.png", [" diagnose: ", "no such option: --figures", "--figure"]),
        ("report m.toml", ["missing argument 'DATA'", " report [OPTIONS] {MODEL} {DATA}, see ", " report --help"]),
        ("compare a b c d", [" compare: ", "extra argument", "(c d)"]),
        ("camera read photos", [" camera read: ", "missing option '--poses'"]),
        ("auto m.toml d.csv --max-effects -1", ["'--max-effects'", "should be greater than or equal to 0"]),
        ("design lrm-lab -n", ["option '-n' requires an argument"]),
    ],
)
def test_a_command_that_is_called_wrongly_says_so_in_one_line(command: str, faults: list[str], tmp_path: Path) -> None:
    free, narrow = (piped(columns, *command.split(), cwd=tmp_path) for columns in (None, 80))
    assert (free.returncode, narrow.returncode, free.stdout, narrow.stdout) == (2, 2, "", "")
    assert len(free.stderr.splitlines()) == 1
    assert free.stderr.startswith("error: ")
    for words in faults:
        assert words in free.stderr
    assert all(len(line) <= 80 for line in narrow.stderr.splitlines())
    assert words_of(narrow.stderr) == words_of(free.stderr)


@pytest.mark.parametrize(
    ("terminal", "notebook", "moves"), [(True, False, True), (True, True, False), (False, False, False)]
)
def test_bars_move_on_a_terminal_but_not_below_a_cell(
    terminal: bool, notebook: bool, moves: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A notebook runs `!lrm-ident …` on a terminal of its own, which cannot take a line back."""
    monkeypatch.delenv("JPY_PARENT_PID", raising=False)
    if notebook:
        monkeypatch.setenv("JPY_PARENT_PID", "1")
    monkeypatch.setattr(consoles, "log", Console(stderr=True, force_terminal=terminal))
    assert consoles.animated() is moves
