"""The daemon whose standard error takes nothing: a closed terminal, a stopped pager, a full disk."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.broken_output import BROKEN_OUTPUTS
from tests.support.daemon.daemon_harness import HOME, arm_when_ready, wait_for_link
from tests.support.daemon.daemon_process import (
    START_TIMEOUT,
    BoardProcess,
    DaemonSetup,
    NotifySocket,
    ProcessGroup,
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
