"""An output is never an input, a file beside one, a device or a folder; it is checked before the work."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from tests.conftest import EXAMPLE, ROOT
from tests.support.commands import stderr_of, stdout_of


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for suffix in (".csv", ".toml"):
        shutil.copy(EXAMPLE.with_suffix(suffix), tmp_path / f"run1{suffix}")
    return tmp_path / "run1.csv"


def refused(data: Path, *words: object) -> str:
    """Message of a fit that must be refused, and that it touched no file."""
    before = {path.name: path.read_bytes() for path in data.parent.iterdir() if path.is_file()}
    said = stderr_of("fit", data, *words)
    assert {path.name: path.read_bytes() for path in data.parent.iterdir() if path.is_file()} == before
    return said


@pytest.mark.long
def test_outputs_that_would_destroy_something(data: Path) -> None:
    folder = data.parent
    (folder / "link.toml").symlink_to(data)
    shutil.copy(ROOT / "config" / "arms" / "lrm-lab.toml", folder / "arm.toml")
    for words, said in [
        (["-o", data], "is an input"),
        (["-o", folder / "link.toml"], "is an input"),
        (["--json", folder / "run1.toml"], "is an input"),
        (["-o", folder / "arm.toml"], "lrm/arm/1"),
        (["--arm", folder / "arm.toml", "-o", folder / "arm.toml"], "is an input"),
        (["-o", folder], "is a folder"),
        (["-o", "/dev/null"], "is a device"),
        (["-o", folder / "no" / "model.toml"], "cannot be written"),
        (["-o", folder / "one", "--json", folder / "one"], "the same file"),
        (["-o", folder / "one", "--json", folder / "no" / ".." / "one"], "the same file"),
    ]:
        assert said in refused(data, *words), words


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_that_may_not_be_written(data: Path) -> None:
    closed = data.parent / "closed"
    closed.mkdir(mode=0o500)
    assert "may not write" in refused(data, "-o", closed / "model.toml")


@pytest.mark.long
def test_a_link_is_followed(data: Path) -> None:
    model, link = data.parent / "model.toml", data.parent / "latest.toml"
    model.write_text('schema = "lrm/model/1"\n')
    link.symlink_to(model)
    stdout_of("fit", data, "--parameters", "option3", "-o", link)
    assert link.is_symlink()
    assert "[parameters]" in model.read_text()


@pytest.mark.slow
def test_a_model_beside_its_data_is_not_taken_for_metadata(tmp_path: Path) -> None:
    data = tmp_path / "run1.csv"
    shutil.copy(EXAMPLE, data)
    model = tmp_path / "run1.toml"
    stdout_of("fit", data, "--arm", "lrm-lab", "--parameters", "option3", "-o", model)
    assert "option" not in stdout_of("compare", model, data, "--json", tmp_path / "c.json")
    stdout_of("fit", data, "--arm", "lrm-lab", "--parameters", "option3", "-o", model)


def test_the_format_of_a_figure_is_checked_before_anything_is_read(tmp_path: Path) -> None:
    none = tmp_path / "none"
    for words in (
        ["compare", none, none],
        ["diagnose", none, none],
        ["arm", "show", none],
        ["reach", none],
        ["design", none, "-n", "9", "-o", tmp_path / "o.csv"],
    ):
        said = stderr_of(*words, "--figure", tmp_path / "why.gif")
        assert "cannot draw a .gif file; one of .png, .svg, .pdf" in said
