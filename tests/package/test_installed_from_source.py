"""pip installs the source distribution in an empty environment: it compiles the kernel, or says why it could not."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from tests.conftest import ROOT

PIP = ("install", "--quiet", "--disable-pip-version-check", "--no-index", "--no-deps", "--no-build-isolation")
KERNEL = "from lrm_math.ik.kernel.shared_library import BUILT, kernel; kernel(); print(BUILT)"


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source distribution of this checkout."""
    pytest.importorskip("hatchling", reason="hatchling is not installed")
    folder = tmp_path_factory.mktemp("sdist")
    builder = "from hatchling.build import build_sdist; import sys; print(build_sdist(sys.argv[1]))"
    subprocess.run([sys.executable, "-c", builder, str(folder)], cwd=ROOT, check=True, capture_output=True)
    (archive,) = folder.glob("lrm_arm-*.tar.gz")
    return archive


def installed(folder: Path, sdist: Path, **more: str) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """Python of an empty environment, and what pip said when it installed the source distribution there.

    What builds and what the program needs is that of this environment, by a path file, and nothing of the checkout.
    """
    venv.create(folder, with_pip=False)
    own = folder / "bin" / "python"
    where = subprocess.run([own, "-c", "import site; print(site.getsitepackages()[0])"], capture_output=True, text=True)
    here = [path for path in sys.path if path.endswith("site-packages")]
    Path(where.stdout.strip(), "beside.pth").write_text("\n".join(here) + "\n", encoding="utf-8")
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "LRM_"))} | more
    command = [sys.executable, "-m", "pip", "--python", str(own), *PIP, str(sdist)]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    return own, done


def run(own: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Python of that environment, with nothing of this checkout on its path."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    return subprocess.run([own, *words], cwd=own.parent, env=environment, capture_output=True, text=True, timeout=120)


@pytest.mark.soak
def test_it_compiles_the_kernel(sdist: Path, tmp_path: Path) -> None:
    own, done = installed(tmp_path / "compiled", sdist)
    assert done.returncode == 0, done.stderr
    found = run(own, "-c", KERNEL)
    assert found.returncode == 0, found.stderr
    assert found.stdout.startswith(str(tmp_path))


def test_without_a_compiler_the_offline_tool_works_without_the_kernel(sdist: Path, tmp_path: Path) -> None:
    own, done = installed(tmp_path / "without", sdist, CC="false", LRM_WITHOUT_KERNEL="1")
    assert done.returncode == 0, done.stderr
    missing = run(own, "-c", KERNEL)
    assert "the compiled kernel of inverse kinematics is missing" in missing.stderr
    fitted = "import lrm_ident as lrm; print(lrm.Study.of(lrm.load(lrm.EXAMPLE)).fit())"
    found = run(own, "-c", fitted)
    assert found.returncode == 0, found.stderr
    assert "45 free parameters" in found.stdout


def test_a_failing_compiler_ends_the_installation_with_advice(sdist: Path, tmp_path: Path) -> None:
    """A daemon without inverse kinematics is no daemon: nobody gets one unasked."""
    _, done = installed(tmp_path / "failed", sdist, CC="false")
    assert done.returncode != 0
    assert "the compiled kernel of inverse kinematics could not be built" in done.stderr
    assert "LRM_WITHOUT_KERNEL=1" in done.stderr
