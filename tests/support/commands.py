"""`lrm-ident` run in this process, its parallel work too: no second spent on starting Python and importing scipy."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest import mock

from lrm_ident.cli.app import main
from lrm_ident.fitting import executors
from lrm_ident.fitting.cross_validation import MOST_REFITTED
from tests.conftest import EXAMPLE

FEW = MOST_REFITTED + 1
"""Poses that take a command least time: of fewer it fits every fold anew."""


def run_command(*words: object, program: Callable[[], None] = main) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of `lrm-ident WORDS`, or of another program."""
    stdout, stderr, code = io.StringIO(), io.StringIO(), 0
    with (
        mock.patch.object(sys, "argv", ["lrm-ident", *map(str, words)]),
        mock.patch.object(executors, "ProcessPoolExecutor", _one_thread),
        contextlib.redirect_stdout(stdout),
        contextlib.redirect_stderr(stderr),
    ):
        try:
            program()
        except SystemExit as end:
            code = int(end.code or 0)
    return code, stdout.getvalue(), stderr.getvalue()


def _one_thread(*_: object, **__: object) -> ThreadPoolExecutor:
    """In the place of processes, which import everything anew (tests/ident/fitting/test_executors.py starts them)."""
    return ThreadPoolExecutor(1)


def part_of_example(folder: Path, poses: int = FEW) -> Path:
    """The first poses of the shipped data set, as a file."""
    path = folder / "part.csv"
    path.write_text("\n".join(EXAMPLE.read_text().splitlines()[: poses + 1]) + "\n")
    path.with_suffix(".toml").write_text(EXAMPLE.with_suffix(".toml").read_text())
    return path


def stdout_of(*words: object, program: Callable[[], None] = main, code: int = 0) -> str:
    """Stdout of a command that must end with an exit code, by default that of success."""
    ended, stdout, stderr = run_command(*words, program=program)
    assert ended == code, stderr
    return stdout


def stderr_of(*words: object, program: Callable[[], None] = main) -> str:
    """Stderr of a command that must end with exit code 2 and one line."""
    code, stdout, stderr = run_command(*words, program=program)
    assert code == 2, stdout + stderr
    assert len(stderr.splitlines()) == 1, stderr
    assert stderr.startswith("error: ")
    return stderr
