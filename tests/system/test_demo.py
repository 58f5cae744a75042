"""The demo, as somebody runs it who sees the project for the first time."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from tests.support.daemon.daemon_process import wait_for


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
