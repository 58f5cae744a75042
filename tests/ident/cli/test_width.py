"""Width of output: as wide as the terminal, or as COLUMNS says, and breaks at spaces."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from tempfile import TemporaryDirectory

import pytest
from rich.console import Console

from lrm_ident.cli import consoles
from tests.conftest import EXAMPLE, ROOT

FIT = f"fit {EXAMPLE} -o model.toml"
HELPS = ("fit", "design", "arm", "reach")
FAULTS = {
    "frobnicate": ["no such command 'frobnicate'", "COMMAND [ARGS]..., see "],
    "diagnose --figures why.png": [" diagnose: ", "no such option: --figures", "--figure"],
    "report m.toml": ["missing argument 'DATA'", " report [OPTIONS] {MODEL} {DATA}, see ", " report --help"],
    "compare a b c d": [" compare: ", "extra argument", "(c d)"],
    "camera read photos": [" camera read: ", "missing option '--poses'"],
    "auto m.toml d.csv --max-effects -1": ["'--max-effects'", "should be greater than or equal to 0"],
    "design lrm-lab -n": ["option '-n' requires an argument"],
}
IN_ORDER = """
import json, os, sys
from lrm_ident.cli import consoles
columns = os.environ.get("COLUMNS")
from tests.support.commands import run_command
if columns:
    os.environ["COLUMNS"] = columns  # tests.conftest takes it away
print(json.dumps({line: run_command(*line.split()) for line in json.load(sys.stdin)}))
"""


@cache
def piped(columns: int | None) -> dict[str, tuple[int, str, str]]:
    """Exit code, stdout and stderr of every command line here, in one process in a pipe that has this width."""
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"} | {"PYTHONPATH": str(ROOT)}
    if columns is not None:
        environment["COLUMNS"] = str(columns)
    lines = json.dumps([*(f"{command} --help" for command in HELPS), *FAULTS, FIT])
    with TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", IN_ORDER], input=lines, capture_output=True, text=True, cwd=folder, env=environment
        )
    assert done.returncode == 0, done.stderr
    return {line: (code, said, failed) for line, (code, said, failed) in json.loads(done.stdout).items()}


def words_of(text: str) -> list[str]:
    """Words and numbers, without the lines of tables."""
    return sorted(word for word in text.split() if word.strip("─"))


@pytest.mark.long
@pytest.mark.parametrize("command", HELPS)
def test_help_is_wrapped_at_spaces(command: str) -> None:
    (code, wide, _), (_, narrow, _) = (piped(columns)[f"{command} --help"] for columns in (110, 80))
    assert code == 0
    assert all(len(line) <= 80 for line in narrow.splitlines())
    assert words_of(narrow) == words_of(wide)


@pytest.mark.long
@pytest.mark.parametrize("columns", [80, 110])
def test_results_are_wrapped_at_spaces_where_a_width_is_known(columns: int) -> None:
    (code, free, _), (_, narrow, _) = piped(None)[FIT], piped(columns)[FIT]
    assert code == 0
    long = [line for line in narrow.splitlines() if len(line) > columns]
    assert all(line.startswith("Next: lrm-ident ") for line in long), "only a command to copy stays on one line"
    assert words_of(narrow) == words_of(free)
    assert max(map(len, free.splitlines())) > 110, "in a pipe a sentence is one line"


@pytest.mark.long
@pytest.mark.parametrize("command", FAULTS)
def test_a_command_that_is_called_wrongly_says_so_in_one_line(command: str) -> None:
    (code, none, free), (_, nothing, narrow) = piped(None)[command], piped(80)[command]
    assert (code, none, nothing) == (2, "", "")
    assert len(free.splitlines()) == 1
    assert free.startswith("error: ")
    for words in FAULTS[command]:
        assert words in free
    assert all(len(line) <= 80 for line in narrow.splitlines())
    assert words_of(narrow) == words_of(free)


@pytest.mark.parametrize(
    ("terminal", "notebook", "moves"), [(True, False, True), (True, True, False), (False, False, False)]
)
def test_bars_move_on_a_terminal(terminal: bool, notebook: bool, moves: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A notebook runs `!lrm-ident …` on a terminal of its own, which cannot take a line back."""
    monkeypatch.delenv("JPY_PARENT_PID", raising=False)
    if notebook:
        monkeypatch.setenv("JPY_PARENT_PID", "1")
    monkeypatch.setattr(consoles, "log", Console(stderr=True, force_terminal=terminal))
    assert consoles.animated() is moves
