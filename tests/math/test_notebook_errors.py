"""Errors in a notebook: IPython shows what `_render_traceback_` gives, in place of a traceback."""

from __future__ import annotations

import pickle
import runpy
from pathlib import Path

import pytest

from lrm_math.errors import FileError, LrmError

CELL = """from lrm_math.arm.arm_file import load_arm

def mine(name):
    return load_arm(name)

mine("so99")
"""


def test_the_users_own_lines_and_the_message_are_shown_and_none_of_ours(tmp_path: Path) -> None:
    cell = tmp_path / "cell.py"
    cell.write_text(CELL, encoding="utf-8")
    with pytest.raises(FileError) as caught:
        runpy.run_path(str(cell), run_name="__main__")
    *lines, message = caught.value._render_traceback_()
    assert lines == ['line 6: mine("so99")', "line 4: return load_arm(name)"]
    assert message == f"FileError: {caught.value}"


def test_notes_stand_below_the_message_also_after_another_process() -> None:
    error = LrmError("nothing is fitted yet")
    error.add_note("fit first")
    assert error._render_traceback_() == ["LrmError: nothing is fitted yet", "fit first"]
    assert pickle.loads(pickle.dumps(error))._render_traceback_() == error._render_traceback_()
