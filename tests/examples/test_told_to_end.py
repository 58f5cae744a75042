"""A demo that is told to end: its simulated rover ends with it, and no further command is run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer import Exit

from examples.demo import steps
from examples.demo.steps import DemoSteps
from lrm_math.errors import LrmError
from tests.conftest import ROOT

PROGRAM = """
import signal, sys, tempfile
from pathlib import Path
from examples.demo.world import simulated_world
if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, simulated_world(Path(folder), 0):
        print("ready", flush=True)
        signal.pause()
"""
PATIENCE_S = 60.0


def descendants(pid: int) -> set[int]:
    """Processes that a process started, and those that they did."""
    listed = f"/proc/{pid}/task/{pid}/children"
    own = {int(word) for word in Path(listed).read_text(encoding="ascii").split()}
    return own.union(*(descendants(one) for one in own)) if own else own


def runs(pid: int) -> bool:
    """Whether a process is there, and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.slow
def test_a_simulated_rover_ends_with_its_program(tmp_path: Path) -> None:
    """Board, daemon with its processes, and tracker."""
    program = tmp_path / "demo.py"
    program.write_text(PROGRAM, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    with subprocess.Popen([sys.executable, program], stdout=subprocess.PIPE, text=True, env=environment) as demo:
        assert demo.stdout.readline() == "ready\n"
        started = descendants(demo.pid)
        demo.send_signal(signal.SIGTERM)
        assert demo.wait() == 1
    assert len(started) >= 3
    end = time.monotonic() + PATIENCE_S
    while any(map(runs, started)) and time.monotonic() < end:
        time.sleep(0.05)
    left = [pid for pid in started if runs(pid)]
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert not left


@pytest.mark.parametrize(("code", "ends"), [(1, SystemExit), (130, SystemExit), (3, LrmError)])
def test_a_command_that_a_signal_ended_ends_the_demo(
    code: int, ends: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where it raises an error as any other, a program that runs many demos begins it anew."""
    monkeypatch.setattr(steps, "app", lambda *_, **__: Exit(code).exit_code)
    with pytest.raises(ends):
        DemoSteps(tmp_path, (), 0, "1").measure()
