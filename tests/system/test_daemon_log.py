"""A daemon whose standard error takes nothing, and one whose program files change under it."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.support.broken_output import BROKEN_OUTPUTS
from tests.support.daemon.daemon_harness import HOME, arm_when_ready, wait_for_link
from tests.support.daemon.daemon_process import (
    SLOW_BOARD,
    START_TIMEOUT,
    BoardProcess,
    DaemonSetup,
    NotifySocket,
    ProcessGroup,
    is_alive,
    running_daemon,
    wait_for,
)


@pytest.mark.parametrize("output", BROKEN_OUTPUTS)
def test_a_log_that_nobody_reads_stops_nothing(tmp_path: Path, output: Callable[[], int]) -> None:
    setup, systemd = DaemonSetup.make(tmp_path), NotifySocket(tmp_path / "notify")
    command = [str(Path(sys.executable).with_name("lrmd")), "--config", str(setup.config)]
    errors = os.fdopen(output(), "wb")
    with errors, BoardProcess(setup), ProcessGroup(command, errors, NOTIFY_SOCKET=str(systemd.path)) as daemon:
        systemd.wait_for("READY=1", START_TIMEOUT)
        with setup.rover() as rover:
            wait_for_link(rover)
            with rover.control("test"):
                arm_when_ready(rover, "given", HOME)
                rover.move({"joint1": 0.05})
            assert "link_up" in [event.code for event in rover.events()]
        daemon.signal(signal.SIGTERM)
        assert daemon.process.wait(10) == 0
    systemd.close()


def test_an_ik_process_that_cannot_start_lets_no_arm_fall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "program"
    for package in ("lrmd", "lrm_math"):
        shutil.copytree(ROOT / package, program / package, ignore=shutil.ignore_patterns("*.pyc.*"))  # being written
    shutil.copytree(ROOT / "config", program / "config")
    monkeypatch.setenv("PYTHONPATH", str(program))
    setup = DaemonSetup.make(tmp_path, SLOW_BOARD)
    with running_daemon(setup) as (board, daemon), setup.rover() as rover:
        wait_for_link(rover)
        with rover.control("test"):
            arm_when_ready(rover, "given", HOME)
            wait_for(lambda: len(board.pulses()) == 6, "all have pulses")
            broken = program / "lrmd" / "ik" / "process.py"
            broken.write_text("raise SystemExit('another release')\n", encoding="utf-8")
            os.kill(daemon.child("ik"), signal.SIGKILL)
            wait_for(lambda: "ik_given_up" in daemon.codes(), "it is given up for a while", 120.0, pause=0.1)
            rover.move({"joint1": 0.01})
            time.sleep(0.3)
        assert is_alive(daemon.pid)
        assert "given_up" not in daemon.codes()
        assert len(board.pulses()) == 6
        shutil.copyfile(ROOT / "lrmd" / "ik" / "process.py", broken)
        wait_for(lambda: rover.metrics().ik_starts > 10, "it is tried again", 60.0, pause=0.1)
