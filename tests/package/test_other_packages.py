"""The packages beside the wheel: integrations, Debian's, conda's, ROS's index; each says what pyproject.toml says."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import pytest
import yaml

from tests.conftest import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
INTEGRATIONS = sorted(path.parent for path in (ROOT / "integrations").glob("*/pyproject.toml"))
CONDA_NAMES = {"msgpack": "msgpack-python", "matplotlib": "matplotlib-base"}


def test_the_recipe_for_conda_asks_for_what_the_package_asks_for() -> None:
    recipe = yaml.safe_load((ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    asked = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["ident"]]
    parts = [re.match(r"([a-z0-9-]+)(.*)", one) for one in asked]
    expected = [f"{CONDA_NAMES.get(one[1], one[1])} {one[2]}" for one in parts if one]
    assert recipe["requirements"]["run"] == [f"python {PROJECT['requires-python']}", *expected]
    assert recipe["context"]["version"] == PROJECT["version"]
    scripts = [f"{name} = {where}" for name, where in PROJECT["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == scripts


@pytest.fixture(scope="module")
def integrations(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Their wheels, by the folder's name; each is built of its source distribution."""
    folder = tmp_path_factory.mktemp("integrations")
    for project in INTEGRATIONS:
        words = [sys.executable, "-m", "hatchling", "build", "--directory", str(folder)]
        subprocess.run(words, cwd=project, check=True, capture_output=True)
    return {project.name: next(folder.glob(f"{project.name}-*.whl")) for project in INTEGRATIONS}


@pytest.mark.parametrize("project", INTEGRATIONS, ids=lambda project: project.name)
def test_an_integration_is_of_the_projects_version_and_needs_the_project(project: Path) -> None:
    described = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert described["version"] == PROJECT["version"]
    assert f"{PROJECT['name']}>=0.1" in described["dependencies"]
    assert described["requires-python"] == PROJECT["requires-python"]


def test_an_integration_has_its_own_code_alone(integrations: dict[str, Path], wheel: Path) -> None:
    for name, own in integrations.items():
        with zipfile.ZipFile(own) as opened, zipfile.ZipFile(wheel) as project:
            tops = {entry.split("/")[0] for entry in opened.namelist()}
            assert {one for one in tops if ".d" not in one} == {name}
            assert not [entry for entry in project.namelist() if name in entry]


def test_the_projects_extra_brings_the_bridge_and_its_command(integrations: dict[str, Path]) -> None:
    assert PROJECT["optional-dependencies"]["ros2"] == ["lrm-ros2>=0.1"]
    with zipfile.ZipFile(integrations["lrm_ros2"]) as opened:
        (entries,) = (name for name in opened.namelist() if name.endswith("entry_points.txt"))
        assert "lrm-ros2 = lrm_ros2.command:main" in opened.read(entries).decode()


def test_ros_finds_the_package_where_the_wheel_is_installed(integrations: dict[str, Path]) -> None:
    described = ET.parse(ROOT / "integrations" / "lrm_ros2" / "package.xml").getroot()
    assert described.findtext("name") == "lrm_ros2"
    assert described.findtext("version") == PROJECT["version"]
    with zipfile.ZipFile(integrations["lrm_ros2"]) as opened:
        placed = {name.partition(".data/data/")[2] for name in opened.namelist()}
    assert {"share/lrm_ros2/package.xml", "share/ament_index/resource_index/packages/lrm_ros2"} <= placed


def test_the_debian_package_keeps_nothing_without_a_known_hash() -> None:
    text = (ROOT / "packaging" / "deb.sh").read_text(encoding="utf-8")
    assert text.count("pip install") == 1, "in the function that all calls go through"
    assert re.findall(r"^ *pip (.*)$", text, re.MULTILINE) == [
        '--require-hashes -r "$REQUIREMENTS"',
        '--require-hashes -r "$SOURCE/systemd/compiler.txt"',
        '--no-deps --no-build-isolation "$WHAT"',
    ]


def test_the_debian_package_runs_from_where_it_is_unpacked(wheel: Path, tmp_path: Path) -> None:
    if shutil.which("dpkg-deb") is None:
        pytest.skip("dpkg-deb is not on this machine")
    none = tmp_path / "requirements.txt"
    none.touch()
    environment = os.environ | {"PYTHON": sys.executable, "OUT": str(tmp_path), "REQUIREMENTS": str(none)}
    script = [ROOT / "packaging" / "deb.sh", wheel]
    done = subprocess.run(script, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (package,) = tmp_path.glob("lrm-arm_*.deb")
    assert done.stdout.strip() == str(package)
    control = subprocess.run(["dpkg-deb", "--field", package], capture_output=True, text=True, check=True).stdout
    assert f"Version: {PROJECT['version']}\n" in control
    assert f"python3 (>= {sys.version_info[0]}.{sys.version_info[1]})" in control
    root = tmp_path / "root"
    subprocess.run(["dpkg-deb", "-x", package, root], check=True)
    assert (root / "usr/lib/systemd/system/lrmd.service").exists()
    assert not (root / "usr/local").exists()
    starter = root / "opt/lrm/current/bin/lrmd"
    unit = (root / "usr/lib/systemd/system/lrmd.service").read_text(encoding="utf-8")
    assert "/opt/lrm/current/bin/lrmd" in unit
    configuration = root / "etc/lrm/lrmd.toml"
    own = tmp_path / "lrmd.toml"
    state = tmp_path / "state"
    own.write_text(configuration.read_text(encoding="utf-8").replace("/var/lib/lrmd", str(state)), encoding="utf-8")
    packages = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}  # its own code alone
    for file, code in ((own, 0), (tmp_path / "none.toml", 2)):  # systemd reads the exit code
        checked = subprocess.run(
            [starter, "--config", file, "--check"], cwd=tmp_path, env=packages, capture_output=True, text=True
        )
        assert checked.returncode == code, checked.stderr
    where = "import lrmd; print(lrmd.__file__)"
    paths = packages | {"PYTHONPATH": str(root / "opt/lrm/current/lib")}
    found = subprocess.run([sys.executable, "-c", where], cwd=tmp_path, env=paths, capture_output=True, text=True)
    assert found.stdout.startswith(str(root))
    conffiles = subprocess.run(["dpkg-deb", "-I", package, "conffiles"], capture_output=True, text=True, check=True)
    assert "/etc/lrm/lrmd.toml" in conffiles.stdout.split()
