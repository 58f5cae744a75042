"""`lrm-ident report-bug`: what is needed is there, and no number of the data is."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.last_error import last_error, note_error
from lrm_ident.report.bug_report import bug_report, file_head
from tests.support.commands import part_of_example, run_command, stdout_of


@pytest.fixture(autouse=True)
def own_state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No error of another test."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def test_versions_the_last_error_and_the_heads_are_there_but_no_value(tmp_path: Path) -> None:
    data = part_of_example(tmp_path, 30)
    assert run_command("fit", tmp_path / "nowhere" / "absent.csv", "-o", tmp_path / "m.toml")[0] == 2
    stdout_of("report-bug", data, data.with_suffix(".toml"), "-o", tmp_path / "bug.txt")
    text = (tmp_path / "bug.txt").read_text(encoding="utf-8")
    assert "lrm-ident fit absent.csv -o m.toml" in text
    assert "FileError: absent.csv: no such file" in text
    assert re.search(r"lrm_ident/cli/fit\.py:\d+ fit", text)
    assert "numpy " in text
    assert "30 rows, names in line 1" in text
    assert "    q1_deg: 30 numbers" in text
    assert "schema = lrm/measurements/1" in text
    assert str(tmp_path) not in text
    assert str(Path.home()) not in text
    rows = list(csv.reader(data.read_text(encoding="utf-8").splitlines()))[1:]
    assert not [cell for row in rows for cell in row if "." in cell and cell in text]
    assert "0.3\n" not in text, "the noise that the metadata state"


def test_a_file_that_is_not_there_is_no_report(tmp_path: Path) -> None:
    """Before: a report on nothing was written."""
    code, _, err = run_command("report-bug", tmp_path / "modle.toml", "-o", tmp_path / "bug.txt")
    assert (code, len(err.splitlines())) == (2, 1)
    assert "modle.toml: no such file" in err
    assert not (tmp_path / "bug.txt").exists()


def test_without_an_error_and_files_it_says_so() -> None:
    text = bug_report(())
    assert "none is known" in text
    assert "none was named" in text


@given(st.lists(st.lists(st.floats(1e3, 1e6), min_size=2, max_size=3), min_size=1, max_size=5))
def test_numbers_in_place_of_names_stay_home(tmp_path_factory: pytest.TempPathFactory, rows: list[list[float]]) -> None:
    """A file without a header: its first row holds measurements."""
    width = min(map(len, rows))
    path = tmp_path_factory.mktemp("data") / "bare.csv"
    path.write_text("\n".join(",".join(f"{cell:.6f}" for cell in row[:width]) for row in rows) + "\n")
    text = "\n".join(file_head(path))
    assert not [cell for row in rows for cell in row[:width] if f"{cell:.6f}" in text]


@pytest.mark.parametrize(
    ("name", "content", "shown"),
    [
        ("absent.csv", None, "cannot be read"),
        ("empty.csv", b"", "no table"),
        ("noise.csv", bytes(range(256)) * 4, "no table"),
        ("broken.toml", b"a = [", "cannot be parsed"),
        ("deep.json", b'{"a": {"b": [1, 2]}}', "a.b: list of 2"),
    ],
)
def test_a_file_of_any_kind_has_a_head(tmp_path: Path, name: str, content: bytes | None, shown: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    assert shown in "\n".join(file_head(tmp_path / name))


def test_a_fault_of_the_code_is_kept_with_its_places() -> None:
    try:
        bug_report([Path("/nonexistent"), 1])  # type: ignore[list-item]
    except AttributeError as error:
        note_error(error, ["lrm-ident", "report", "/home/somebody/secret/model.toml"])
    kept = last_error()
    assert kept[1] == "lrm-ident report model.toml"
    assert kept[2].startswith("AttributeError: ")
    assert re.fullmatch(r"  lrm_ident/report/bug_report\.py:\d+ \w+", kept[3])


def test_an_error_is_no_second_one_where_nothing_can_be_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    note_error(ValueError("x"))
    assert last_error() == ()
