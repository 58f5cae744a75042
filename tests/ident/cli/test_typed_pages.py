"""README and two tutorials, typed in order in an empty folder (the third: measuring/camera/test_your_arm.py)."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import pytest

from lrm_ident.data.robot_files.urdf_export import bare_urdf
from lrm_math.arm.arm_file import load_arm
from tests.conftest import EXAMPLE, ROOT
from tests.support.commands import part_of_example, stdout_of
from tests.support.page_commands import commands_of

ELSEWHERE = {
    "workbench": "serves until Ctrl-C: tests/ident/workbench",
    "checkup": "needs a LeRobot dataset: tests/ident/measuring/recordings",
    "motion fit DATASET": "needs a LeRobot dataset: tests/ident/motion",
    "align FIXTURE.csv": "needs the raw readings of two targets: tests/ident/measuring",
}
QUICK = {"auto": ("--no-nested", "--max-effects", "1")}


def typed(page: Path) -> dict[str, str]:
    """What each command of the page printed, by its words; all must succeed."""
    commands = [words for words in commands_of(page) if not elsewhere(words)]
    return {" ".join(words): stdout_of(*words, *QUICK.get(words[0], ())) for words in commands}


def elsewhere(words: Sequence[str]) -> bool:
    """Is it tried by another test."""
    return any(" ".join(words).startswith(begin) for begin in ELSEWHERE)


@pytest.mark.slow
def test_the_tutorial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    printed = typed(ROOT / "docs" / "tutorial.md")
    assert len(printed) == 5
    assert "Missing from the model: backlash in joint 2" in printed["diagnose model.toml DATA.csv"]
    assert "3.03 to 0.57 mm" in printed["add model.toml DATA.csv backlash@joint2 -o better.toml"]
    assert (tmp_path / "REPORT.html").stat().st_size < 2e6


@pytest.mark.soak
@pytest.mark.slow
def test_the_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(EXAMPLE.parent, tmp_path / EXAMPLE.parent.relative_to(ROOT))
    monkeypatch.chdir(tmp_path)
    printed = typed(ROOT / "docs" / "method.md")
    assert len(printed) == 8
    assert "Missing from the model: backlash in joint 2" in printed["diagnose model.toml measurements.csv"]


@pytest.mark.slow
def test_the_readme(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a part of the example as DATA.csv, its arm as a URDF, and a fit to it as the model of the demo."""
    monkeypatch.chdir(tmp_path)
    part_of_example(tmp_path).rename("DATA.csv")
    Path("part.toml").rename("DATA.toml")
    Path("robot.urdf").write_text(ElementTree.tostring(bare_urdf(load_arm("lrm-lab")).tree, encoding="unicode"))
    Path("lrm-demo").mkdir()
    stdout_of("fit", "DATA.csv", "--arm", "lrm-lab", "-o", "lrm-demo/best.toml")
    printed = typed(ROOT / "README.md")
    assert len(printed) == 7
    assert "backlash@joint2" in printed["diagnose model.toml DATA.csv"]
    assert Path("report.html").exists()
    assert Path("sockets.stl").exists()
