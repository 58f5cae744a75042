"""The built wheel in empty environments: the base runs the daemon, the extra `ident` runs the offline tool."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement

from lrm_math.arm.arm_file import load_arm
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.kernel import shared_library
from lrm_math.model.model import model_of
from tests.conftest import ROOT
from tests.support.commands import part_of_example
from tests.support.daemon.daemon_process import free_port

PIP = ("install", "--quiet", "--disable-pip-version-check", "--no-index", "-c", ROOT / "constraints.txt")
READY = 60.0


def test_the_wheel_is_for_this_platform_and_any_python_and_has_the_kernel(wheel: Path) -> None:
    assert wheel.name.startswith("lrm_arm-")
    assert "-py3-none-" in wheel.name
    assert not wheel.name.endswith("-any.whl")
    with zipfile.ZipFile(wheel) as opened:
        names = opened.namelist()
    assert f"lrm_math/ik/kernel/{shared_library.BUILT.name}" in names
    assert "lrm_math/ik/kernel/ik_kernel.c" in names


def test_the_source_distribution_builds_the_same_wheel(tmp_path: Path) -> None:
    """It has the C source and the hook."""
    builder = "from hatchling.build import build_sdist; import sys; print(build_sdist(sys.argv[1]))"
    pytest.importorskip("hatchling", reason="hatchling is not installed")
    subprocess.run([sys.executable, "-c", builder, str(tmp_path)], cwd=ROOT, check=True, capture_output=True)
    (archive,) = tmp_path.glob("lrm_arm-*.tar.gz")
    with tarfile.open(archive) as opened:
        names = {name.split("/", 1)[1] for name in opened.getnames() if "/" in name}
    assert {"lrm_math/ik/kernel/ik_kernel.c", "hatch_build.py", "pyproject.toml"} <= names
    assert not any(name.endswith((".so", ".dylib", ".dll")) for name in names)


def test_a_wheel_for_an_unknown_machine_is_refused() -> None:
    pytest.importorskip("hatchling", reason="hatchling is not installed")
    environment = os.environ | {"LRM_WHEEL_TARGET": "abacus"}
    done = subprocess.run(
        [sys.executable, str(ROOT / "hatch_build.py")], env=environment, capture_output=True, text=True
    )
    assert done.returncode != 0
    assert done.stderr.startswith("LRM_WHEEL_TARGET = abacus; should be one of manylinux_2_17_x86_64")


def test_without_a_compiler_ziglang_builds_the_same_kernel(tmp_path: Path) -> None:
    """PATH has no cc; a command's forward kinematics agrees to round-off."""
    pytest.importorskip("hatchling", reason="hatchling is not installed")
    pytest.importorskip("ziglang", reason="ziglang is not installed; pip fetches it where there is no compiler")
    source = tmp_path / shared_library.SOURCE.relative_to(ROOT)
    source.parent.mkdir(parents=True)
    shutil.copy(shared_library.SOURCE, source)
    script = shutil.copy(ROOT / "hatch_build.py", tmp_path)
    environment = {key: value for key, value in os.environ.items() if key != "CC"} | {"PATH": str(tmp_path)}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    library = shared_library.loaded(source.with_name(shared_library.BUILT.name))
    arm = CalibratedSolver.of(model_of(load_arm("lrm-rover"), ())).context.arm(0.0)
    s, frames = np.full(arm.slots, 0.3), [np.empty(12 * (arm.slots + 1)) for _ in range(2)]
    for functions, out in zip((library, shared_library.kernel()), frames, strict=True):
        functions.ik_frames(arm.address, 1, s.ctypes.data, out.ctypes.data)
    np.testing.assert_allclose(*frames, atol=1e-14)


def needed(wheel: Path, *extras: str) -> dict[str, importlib.metadata.Distribution]:
    """Distributions that a wheel with these extras declares, and those that they declare, by name."""
    (metadata,) = (part for part in zipfile.Path(wheel).iterdir() if part.name.endswith(".dist-info"))
    found: dict[str, importlib.metadata.Distribution] = {}
    todo = [(importlib.metadata.PathDistribution(metadata), {"", *extras})]  # type: ignore[arg-type]
    while todo:
        distribution, wanted = todo.pop()
        for requirement in map(Requirement, distribution.requires or ()):
            marker, name = requirement.marker, requirement.name
            if name not in found and (marker is None or any(marker.evaluate({"extra": one}) for one in wanted)):
                found[name] = importlib.metadata.distribution(name)
                todo.append((found[name], {"", *requirement.extras}))
    return found


def installed(folder: Path, wheel: Path, *extras: str) -> Path:
    """The folder of programs of a new environment with the wheel, what it declares, and nothing else.

    What it declares is linked from this environment; pip refuses if anything of it is missing or of another version.
    """
    venv.create(folder)
    packages = Path(sysconfig.get_path("purelib", "venv", {"base": str(folder)}))
    for distribution in needed(wheel, *extras).values():
        for name in {file.parts[0] for file in distribution.files or ()} - {"..", "__pycache__"}:
            (packages / name).symlink_to(str(distribution.locate_file(name)))
    requirement = f"lrm-arm[{','.join(extras)}] @ {wheel.as_uri()}"
    own = folder / "bin" / "python"
    subprocess.run([sys.executable, "-m", "pip", "--python", own, *PIP, requirement], check=True)
    return folder / "bin"


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A program with nothing of this checkout on its path."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=120)


def test_the_base_runs_the_daemon_and_says_what_the_offline_tool_needs(wheel: Path, tmp_path: Path) -> None:
    programs = installed(tmp_path / "base", wheel)
    config = tmp_path / "lrmd.toml"
    shipped = (ROOT / "config" / "lrmd.toml").read_text()
    own = {"/var/lib/lrmd": str(tmp_path / "state"), "127.0.0.1:7447": f"127.0.0.1:{free_port()}"}
    for shared, private in own.items():
        assert shared in shipped
        shipped = shipped.replace(shared, private)
    config.write_text(shipped)
    assert run(programs / "lrmd", "--config", config, "--check", cwd=tmp_path).returncode == 0
    schemas = "from lrmd.messages.json_schemas import FILE, text; assert FILE.read_text(encoding='utf-8') == text()"
    assert run(programs / "python", "-c", schemas, cwd=tmp_path).returncode == 0
    daemon = subprocess.Popen(
        [programs / "lrmd", "--config", config, "--simulated"], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    try:
        assert any('"ready"' in line for line in iter(daemon.stderr.readline, ""))
    finally:
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(READY) == 0
    refused = run(programs / "lrm-ident", "--help", cwd=tmp_path)
    assert refused.returncode == 2
    assert refused.stderr.startswith("error: lrm-ident needs the package")
    assert "pip install 'lrm-arm[ident]'" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1


def test_the_extra_runs_the_offline_tool(wheel: Path, tmp_path: Path) -> None:
    programs = installed(tmp_path / "ident", wheel, "ident")
    data = part_of_example(tmp_path)
    fitted = run(programs / "lrm-ident", "fit", data, "-o", tmp_path / "model.toml", cwd=tmp_path)
    assert fitted.returncode == 0, fitted.stderr
    assert (tmp_path / "model.toml").exists()
    plotted = run(programs / "lrm-ident", "compare", "model.toml", data, "--figure", "where.png", cwd=tmp_path)
    assert plotted.returncode == 0, plotted.stderr
    assert (tmp_path / "where.png").stat().st_size > 10_000
    report = run(programs / "lrm-ident", "report", "model.toml", data, "-o", "r.html", cwd=tmp_path)
    assert report.returncode == 0, report.stderr
    refused = run(programs / "lrm-ident", "workbench", "--no-open", cwd=tmp_path)
    assert refused.returncode == 2
    assert refused.stderr.splitlines()[-1].endswith("pip install 'lrm-arm[page]'")
