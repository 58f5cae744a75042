"""A campaign on the real daemon and a simulated board: killed, the arm holds; resumed, every pose is there once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.measuring.tracker.udp import UdpTracker
from lrm_math.arm.arm_file import load_arm
from tests.support.daemon.daemon_process import SLOW_BOARD, DaemonSetup, running_daemon, wait_for
from tests.support.daemon.tracker_of_board import tracker_of

POSES = 5
HEAD = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n"


def test_killed_the_arm_holds_and_resumed_no_pose_is_lost_or_doubled(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path, {**SLOW_BOARD, "step_us = 1.0": "step_us = 10.0"})
    q = np.array([[0, -60, 0, 0, 0, 0]]) + 10.0 * np.arange(1, POSES + 1)[:, None] * [1, 0, 1, -1, 0, 1]
    poses, data = tmp_path / "poses.csv", tmp_path / "data.csv"
    rows = [",".join([str(k), *(f"{angle:g}" for angle in row)]) for k, row in enumerate(q, start=1)]
    poses.write_text(HEAD + "\n".join(rows) + "\n")
    with UdpTracker("127.0.0.1", 0) as probe:
        port = probe.port
    command = [sys.executable, "-m", "lrm_ident", "measure", str(poses), "--connect", setup.endpoint]
    command += ["--tracker", f"dtrack:{port}", "-o", str(data), "--pause", "0.8", "--dwell", "0.4"]
    daemon = running_daemon(setup, "--start-deg", "0,-60,0,0,0,0")
    with daemon as (board, _), tracker_of(board, port), setup.rover() as rover:
        names = rover.info().names[:6]
        with rover.control("test"):
            rover.arm("given", dict(zip(names, np.radians([0.0, -60.0, 0, 0, 0, 0]).tolist(), strict=True)))
        first = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        wait_for(lambda: data.exists() and data.read_bytes().count(b"\n") >= 3, "two rows", 60.0)
        first.kill()
        first.wait()
        wait_for(lambda: rover.mode().holder is None and rover.mode().mode in ("holding", "armed"), "it holds")
        assert all(rover.joints().on[:6])
        with data.open("ab") as file:  # what a crash of the computer may leave
            file.write(b"4,12.5,1,0.0")
        again = subprocess.run(command, capture_output=True, text=True, timeout=120)
        assert again.returncode == 0, again.stdout + again.stderr
    found = load_measurements(data, load_arm("lrm-rover"))
    assert found.pose.tolist() == list(range(1, POSES + 1))
    assert found.notices == ()
    np.testing.assert_allclose(np.degrees(found.poses.q), q, atol=0.1)
    assert found.poses.session is not None
    assert set(found.poses.session.tolist()) == {1.0}
