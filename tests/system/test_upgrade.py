"""Files of the program that change under a running daemon: what cannot start any more ends nothing that works."""

from __future__ import annotations

import os
import shutil
import signal
import time
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.support.daemon.daemon_harness import HOME, arm_when_ready, wait_for_link
from tests.support.daemon.daemon_process import SLOW_BOARD, DaemonSetup, is_alive, running_daemon, wait_for


def test_an_ik_process_that_cannot_start_lets_no_arm_fall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "program"
    for package in ("lrmd", "lrm_math"):
        shutil.copytree(ROOT / package, program / package, ignore=shutil.ignore_patterns("__pycache__"))
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
