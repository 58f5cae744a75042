"""One daemon per state directory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from lrm_math.errors import FileError
from lrmd.persistence.sole_user import sole_user

HOLDER = """
import sys, time
from pathlib import Path
from lrmd.persistence.sole_user import sole_user
with sole_user(Path(sys.argv[1])):
    print("there", flush=True)
    time.sleep(60)
"""


def test_a_second_one_is_refused_until_the_first_is_gone_however_it_ends(tmp_path: Path) -> None:
    folder = tmp_path / "state" / "of" / "mine"
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(folder)], stdout=subprocess.PIPE, text=True) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == "there\n"
        with pytest.raises(FileError, match="another lrmd") as refused, sole_user(folder):
            pass
        assert str(refused.value).startswith(f"{folder}: ")
        first.kill()
    for _ in range(2):
        with sole_user(folder):
            assert list(folder.iterdir()) == []


def test_what_is_raised_inside_is_not_taken_for_another_user(tmp_path: Path) -> None:
    with pytest.raises(BlockingIOError), sole_user(tmp_path):
        raise BlockingIOError


def test_a_folder_that_cannot_be_made_is_no_reason_not_to_start(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with sole_user(tmp_path / "file" / "state"):
        pass
