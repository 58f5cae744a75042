"""Commands run in this process: as a person would type them, without the second that Python takes to start."""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path
from unittest import mock

from lrm_ident.cli.app import main
from tests.conftest import EXAMPLE


def typed(*words: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of `lrm-ident WORDS`."""
    said, complained = io.StringIO(), io.StringIO()
    code = 0
    with (
        mock.patch.object(sys, "argv", ["lrm-ident", *map(str, words)]),
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(complained),
    ):
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
    return code, said.getvalue(), complained.getvalue()


def part_of_example(folder: Path, poses: int) -> Path:
    """The first poses of the shipped data set, as a file: enough for a command that is slow on all of them."""
    path = folder / "part.csv"
    path.write_text("\n".join(EXAMPLE.read_text().splitlines()[: poses + 1]) + "\n")
    path.with_suffix(".toml").write_text(EXAMPLE.with_suffix(".toml").read_text())
    return path


def does(*words: object) -> str:
    """What a command that succeeds prints."""
    code, said, complained = typed(*words)
    assert code == 0, complained
    return said


def refuses(*words: object) -> str:
    """The one line of a command that takes its words or files for wrong."""
    code, _, complained = typed(*words)
    assert code == 2
    assert len(complained.splitlines()) == 1, complained
    assert complained.startswith("error: ")
    return complained
