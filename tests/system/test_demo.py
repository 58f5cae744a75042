"""Programs that newcomers run: the demo, and the client of the docs that needs nothing of ours."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.support.daemon.daemon_process import SLOW_BOARD, DaemonSetup, running_daemon, wait_for


def test_the_demo_shows_the_daemon_at_work_and_leaves_nothing_behind(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "lrmd.demo"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)}, start_new_session=True,
    )  # fmt: skip
    said, complained = process.communicate(timeout=60)
    assert (process.returncode, complained) == (0, "")
    numbers = [[float(word) for word in re.findall(r"-?\d+\.\d", line)] for line in said.splitlines()]
    poses = [row for row in numbers if len(row) == 9]
    assert len(poses) == 4
    assert len({tuple(row[6:]) for row in poses}) == 4
    assert "moving, estop, disarmed" in said
    assert list(tmp_path.iterdir()) == []
    wait_for(lambda: not any(_session(stat) == process.pid for stat in Path("/proc").glob("[0-9]*/stat")), "all end")


def test_a_wrong_speed_is_one_line() -> None:
    done = subprocess.run([sys.executable, "-m", "lrmd.demo", "--speed", "0"], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "--speed" in done.stderr


def _session(stat: Path) -> int:
    """The session that a process belongs to, 0 for one that has ended."""
    try:
        state, _, _, session, *_ = stat.read_text(errors="replace").rpartition(")")[2].split()
    except OSError:
        return 0
    return 0 if state == "Z" else int(session)


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
