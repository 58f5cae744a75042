"""The plug-in's wheel has the name that LeRobot looks for, and needs no LeRobot to be imported."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

from tests.conftest import ROOT


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    words = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(words, cwd=ROOT / "integrations" / "lerobot_robot_lrm", check=True, capture_output=True)
    (made,) = folder.glob("*.whl")
    return made


def test_lerobot_would_find_it_by_its_name(wheel: Path) -> None:
    """LeRobot imports a module by the very name of the distribution, which must not be spelled with hyphens."""
    with ZipFile(wheel) as archive:
        names = archive.namelist()
        metadata = archive.read(next(name for name in names if name.endswith("METADATA"))).decode()
    assert "\nName: lerobot_robot_lrm\n" in metadata
    assert "lerobot_robot_lrm/__init__.py" in names


def test_lerobots_own_discovery_registers_a_calibrated_form_of_its_robots(wheel: Path, tmp_path: Path) -> None:
    pytest.importorskip("lerobot", reason="LeRobot is not installed (it needs torch; Python 3.12 from 0.5 on)")
    with ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    code = (
        "from lerobot.utils.import_utils import register_third_party_plugins as find; find()\n"
        "from lerobot.robots.config import RobotConfig\n"
        "import lerobot_robot_lrm; print(lerobot_robot_lrm.__file__)\n"
        "print(*RobotConfig.get_known_choices())"
    )
    path = {"PYTHONPATH": f"{tmp_path}:{ROOT}"}
    done = subprocess.run([sys.executable, "-c", code], env=path, capture_output=True, text=True, check=True)
    found, choices = done.stdout.splitlines()[-2:]
    assert Path(found).is_relative_to(tmp_path)
    assert {"so100_follower_calibrated", "so101_follower_calibrated"} <= set(choices.split())
