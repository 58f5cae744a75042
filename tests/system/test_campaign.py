"""A campaign on the real daemon and a simulated board: killed, the arm holds; resumed, every pose is there once."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.measuring.tracker.dtrack import UdpTracker
from lrm_math.arm.arm_file import load_arm
from lrmd.client import Rover
from tests.support.daemon.daemon_harness import arm_when_ready, connected, wait_for_link
from tests.support.daemon.daemon_process import SLOW_BOARD, BoardProcess, DaemonSetup, running_daemon, wait_for
from tests.support.daemon.tracker_of_board import tracker_of

POSES = 4
START = (0.0, -60.0, 0.0, 0.0, 0.0, 0.0)
HEAD = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n"


@dataclass(frozen=True)
class CampaignSetup:
    """A plan of poses, the port of a tracker, and the file to measure into."""

    setup: DaemonSetup
    q: np.ndarray
    port: int
    data: Path
    poses: Path

    @classmethod
    def make(cls, folder: Path) -> CampaignSetup:
        setup = DaemonSetup.make(folder, {**SLOW_BOARD, "step_us = 1.0": "step_us = 10.0"})
        q = np.array([[0, -60, 0, 0, 0, 0]]) + 10.0 * np.arange(1, POSES + 1)[:, None] * [1, 0, 1, -1, 0, 1]
        rows = [",".join([str(k), *(f"{angle:g}" for angle in row)]) for k, row in enumerate(q, start=1)]
        poses = folder / "poses.csv"
        poses.write_text(HEAD + "\n".join(rows) + "\n")
        with UdpTracker("127.0.0.1", 0) as probe:
            return cls(setup, q, probe.port, folder / "data.csv", poses)

    def command(self, pause: float) -> list[str]:
        """`lrm-ident measure` with so many seconds a pose."""
        command = [sys.executable, "-m", "lrm_ident", "measure", str(self.poses), "--connect", self.setup.endpoint]
        return [
            *command, "--tracker", f"dtrack:{self.port}", "-o", str(self.data), "--pause", f"{pause}", "--dwell",
            "0.4",
        ]  # fmt: skip

    def rows(self) -> int:
        """Whole rows in the file."""
        return max(self.data.read_bytes().count(b"\n") - 1, 0) if self.data.exists() else 0

    def measured(self) -> Measurements:
        """Content of the file."""
        return load_measurements(self.data, load_arm("lrm-rover"))


def arm_at(rover: Rover, degrees: Sequence[float]) -> None:
    wait_for_link(rover)
    with rover.control("test"):
        if rover.mode().mode == "estop":
            rover.reset_fault()
        arm_when_ready(rover, "given", dict(zip(rover.info().names[:6], np.radians(degrees).tolist(), strict=True)))


def test_killed_the_arm_holds_and_resumed_no_pose_is_lost_or_doubled(tmp_path: Path) -> None:
    bench = CampaignSetup.make(tmp_path)
    daemon = running_daemon(bench.setup, "--start-deg", "0,-60,0,0,0,0")
    with daemon as (board, _), tracker_of(board, bench.port), bench.setup.rover() as rover:
        arm_at(rover, START)
        first = subprocess.Popen(bench.command(0.8), stdout=subprocess.DEVNULL)
        wait_for(lambda: bench.rows() >= 2, "two rows", 60.0)
        first.kill()
        first.wait()
        wait_for(lambda: rover.mode().holder is None and rover.mode().mode in ("holding", "armed"), "it holds")
        assert all(rover.joints().on[:6])
        with bench.data.open("ab") as file:  # what a crash of the computer may leave
            file.write(b"3,12.5,1,0.0")
        again = subprocess.run(bench.command(0.8), capture_output=True, text=True, timeout=120)
        assert again.returncode == 0, again.stdout + again.stderr
    found = bench.measured()
    assert found.pose.tolist() == list(range(1, POSES + 1))
    assert found.source.notices == ()
    np.testing.assert_allclose(np.degrees(found.poses.q), bench.q, atol=0.1)
    assert set(found.poses.session.tolist()) == {1.0}


@pytest.mark.parametrize("what", ["stopped", "taken and moved"])
def test_an_arm_that_did_not_stand_during_its_rest_leaves_no_row(tmp_path: Path, what: str) -> None:
    bench = CampaignSetup.make(tmp_path)
    daemon = running_daemon(bench.setup, "--start-deg", "0,-60,0,0,0,0")
    with daemon as (board, _), tracker_of(board, bench.port), bench.setup.rover() as rover:
        arm_at(rover, START)
        command = bench.command(2.5)
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as campaign:
            wait_for(lambda: bench.rows() >= 1, "a row", 60.0)
            wait_for(lambda: rover.mode().mode == "moving", "the next pose")
            wait_for(lambda: rover.mode().mode == "armed", "the arm is there")
            time.sleep(0.8)  # well into the pause of 2.5 s, on a busy computer too
            if what == "stopped":
                rover.estop("test")
            else:
                with rover.control("somebody else", take=True):
                    rover.move({"joint1": 0.3})
            said, _ = campaign.communicate(timeout=120)
        assert campaign.returncode == 2, said
        assert "pose 2: its row is dropped: " in said
        assert bench.measured().pose.tolist() == [1]


def test_a_daemon_that_was_killed_and_armed_anew_begins_another_session(tmp_path: Path) -> None:
    """Also where the board went on pulsing, and its pulses are adopted."""
    bench = CampaignSetup.make(tmp_path)
    with BoardProcess(bench.setup, "--start-deg", "0,-60,0,0,0,0") as board, tracker_of(board, bench.port):
        with connected(bench.setup) as (daemon, rover):
            arm_at(rover, START)
            campaign = subprocess.Popen(bench.command(0.8), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            wait_for(lambda: bench.rows() >= 2, "two rows", 60.0)
            for process in (campaign, daemon.process):
                process.kill()
                process.wait(10)
        before = bench.rows()
        with connected(bench.setup) as (_, rover):
            wait_for_link(rover)
            with rover.control("test"):
                arm_when_ready(rover, "board")
            again = subprocess.run(bench.command(0.8), capture_output=True, text=True, timeout=120)
            assert again.returncode == 0, again.stdout + again.stderr
    session = bench.measured().poses.session
    assert session.tolist() == [1.0] * before + [2.0] * (POSES - before)
