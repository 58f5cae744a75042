"""The client of the documentation that needs nothing of ours, run against a daemon."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.support.daemon.daemon_process import SLOW_BOARD, DaemonSetup, running_daemon

PROGRAM = ROOT / "docs" / "zenoh_client.py"


def test_the_example_without_our_client_moves_the_arm(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path, SLOW_BOARD)
    with running_daemon(setup):
        done = subprocess.run(
            [sys.executable, str(PROGRAM), setup.endpoint], capture_output=True, text=True, timeout=60, cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        first, refused, last = done.stdout.splitlines()
        assert first.startswith("rover: arm lrm-rover, joints joint1")
        assert refused.startswith("as it should be, limit: joint1")
        largest = float(last.removesuffix(" rad").rpartition(" ")[2])
        assert largest == pytest.approx(0.1, abs=0.02)  # the last of the states may come after it has gone
        nobody = subprocess.run(
            [sys.executable, str(PROGRAM), setup.endpoint, "nobody"], capture_output=True, text=True, timeout=60
        )
        assert nobody.returncode == 1
        assert "no answer from lrm/nobody/info" in nobody.stderr


def test_it_needs_zenoh_and_msgpack_alone() -> None:
    lines = PROGRAM.read_text(encoding="utf-8").splitlines()
    imports = {line.split()[1] for line in lines if line.startswith(("import ", "from "))}
    assert imports - set(sys.stdlib_module_names) == {"zenoh", "msgpack"}
