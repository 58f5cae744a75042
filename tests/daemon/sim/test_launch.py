"""The simulated board as a subprocess: it lives as long as who started it, however that ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lrmd.config import load_config

pytestmark = pytest.mark.long

PROGRAM = """
import os, signal, sys
from lrmd.config import load_config
from lrmd.sim.launch import simulated_board
from pathlib import Path
with simulated_board(load_config(Path(sys.argv[1]))) as config:
    print(config.link.port, config.state, flush=True)
    signal.pause()
"""


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGINT])
def test_the_board_ends_with_its_daemon(end: signal.Signals, tmp_path: Path) -> None:
    config = Path(__file__).resolve().parents[3] / "config" / "lrmd.toml"
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-c", PROGRAM, str(config)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment
    ) as own:
        assert own.stdout is not None
        port, state = map(Path, own.stdout.readline().split())
        assert port.is_symlink()
        assert state == load_config(config).state / "simulated", "the real arm's pose is not that of a simulated one"
        own.send_signal(end)
        own.wait()
    until = time.monotonic() + 10.0
    while port.is_symlink() and time.monotonic() < until:
        time.sleep(0.02)
    assert not port.is_symlink()
