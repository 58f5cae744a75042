"""Files and numbers that people name, errors in a notebook, and the names at the top of lrm_math."""

from __future__ import annotations

import math
import pickle
import runpy
import stat
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import lrm_math
from lrm_math.atomic_file import write_atomically
from lrm_math.errors import FileError, LrmError
from lrm_math.model.model_file import ModelFile
from lrm_math.number_list import parse_numbers
from lrm_math.text_file import read_json, read_utf8
from lrm_math.toml_file import LARGEST, PIECE, bounded_content, parse_toml, read_toml, schema_of


def test_write_keeps_the_mode_of_a_file_that_was_there(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    path.write_bytes(b"old")
    path.chmod(0o640)
    write_atomically(path, b"new")
    assert path.read_bytes() == b"new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_write_through_a_link_changes_what_it_leads_to(tmp_path: Path) -> None:
    target, link = tmp_path / "disk" / "model.toml", tmp_path / "model.toml"
    target.parent.mkdir()
    target.write_bytes(b"old")
    link.symlink_to(target)
    write_atomically(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert {file.name for file in tmp_path.rglob("*")} == {"disk", "model.toml"}


def test_links_in_a_circle_lead_nowhere_and_are_replaced_or_one_line(tmp_path: Path) -> None:
    link, folder = tmp_path / "state.json", tmp_path / "state"
    link.symlink_to(link)
    write_atomically(link, b"new")
    assert (link.is_symlink(), link.read_bytes()) == (False, b"new")
    folder.symlink_to(folder)
    with pytest.raises(FileError, match="cannot be written"):
        write_atomically(folder / "state.json", b"new")


def test_a_content_that_is_refused_leaves_the_folder_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_bytes(b"old")

    def refuse(temporary: Path) -> None:
        assert temporary.read_bytes() == b"new"
        raise LrmError("not this")

    with pytest.raises(LrmError, match="not this"):
        write_atomically(path, b"new", check=refuse)
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [("model.toml", b"old")]


def test_a_folder_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be written"):
        write_atomically(tmp_path / "none" / "model.toml", b"new")


@pytest.mark.parametrize("content", [None, b"\xff\xfe\xfa", b"{"])
def test_what_cannot_be_read_is_named_with_its_file(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "robot.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(FileError, match=r"robot\.json: .*(no such file|cannot be read)"):
        read_json(path)


def test_the_byte_order_mark_of_an_editor_is_no_content(tmp_path: Path) -> None:
    """Before: not valid TOML, Invalid statement at line 1, column 1; and JSON likewise."""
    path = tmp_path / "arm.toml"
    path.write_bytes(b'\xef\xbb\xbfschema = "lrm/arm/1"\n')
    assert parse_toml(path) == {"schema": "lrm/arm/1"}
    assert schema_of(path) == "lrm/arm/1"
    path.write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert read_json(path) == {"a": 1}


def test_a_newer_format_is_no_other_kind_of_file(tmp_path: Path) -> None:
    """Before: do the arguments stand in another order?"""
    path = tmp_path / "model.toml"
    path.write_text('schema = "lrm/model/9"\narm = "lrm-lab"\neffects = []\n')
    with pytest.raises(FileError, match=r"schema = 'lrm/model/9'; should be '.*'; another version of the format"):
        read_toml(path, ModelFile)


def test_another_encoding_is_named_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_bytes('name = "a"\nsource = "Prüfstand"\n'.encode("latin-1"))
    with pytest.raises(FileError, match="line 2: is no text in UTF-8; save it in that encoding"):
        parse_toml(path)


def test_a_folder_is_no_text(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be read"):
        read_utf8(tmp_path)


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1))
def test_numbers_are_read_as_they_were_written(numbers: list[float]) -> None:
    assert parse_numbers("--q", ",".join(map(repr, numbers)), "numbers", len(numbers)) == numbers


@given(st.lists(st.floats(), min_size=1), st.integers(1, 4))
def test_a_wrong_count_or_a_value_that_is_no_number_is_refused(numbers: list[float], count: int) -> None:
    if len(numbers) == count and all(map(math.isfinite, numbers)):
        return
    with pytest.raises(LrmError, match=r"--q .*: should be three"):
        parse_numbers("--q", ",".join(map(repr, numbers)), "three numbers", count)


def test_a_small_file_takes_little_memory_to_read(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_bytes(b"a = 1\n")
    tracemalloc.start()
    try:
        assert parse_toml(path) == {"a": 1}
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def test_a_device_without_an_end_is_read_to_the_largest_size_only() -> None:
    assert LARGEST < len(bounded_content(Path("/dev/zero"))) <= LARGEST + PIECE


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


def test_every_name_at_the_top_is_there() -> None:
    assert all(getattr(lrm_math, name).__module__.startswith("lrm_math") for name in lrm_math.__all__ if name[0] != "C")
    assert set(lrm_math.__all__) == {name for names in lrm_math._NAMES.values() for name in names}


def test_the_package_alone_imports_no_numpy() -> None:
    """The ramp imports modules of it that need none."""
    code = "import sys, lrm_math; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
