"""The simulated arm from a shell: it says what it takes, outlives the shell that started it, and says when it ends."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from examples.so101 import __main__ as program
from examples.so101 import tracker
from examples.so101.hidden_arm import BUSES, HIDDEN
from tests.support.commands import run_command, stderr_of


def test_help_names_every_value() -> None:
    code, said, _ = run_command("--help", program=program.main)
    assert code == 0
    assert all(name in said for name in (*HIDDEN, *BUSES, "SEED", "SPEED", "--calibration"))
    assert "LINK, PORT, SEED; see python -m examples.so101.tracker --help" in stderr_of(program=tracker.main)
    said = stderr_of("so101", "friction", "one", program=program.main)
    assert "SEED: invalid int value: 'one'; see python -m examples.so101 --help" in said
    assert "valid: play, friction, gain" in stderr_of("so101", "sag", "1", program=program.main)
    assert "--dead-time is nan s; should be from 0 to 1 s" in stderr_of(
        "so101", "gain", "1", "--dead-time=nan", program=program.main
    )


def test_a_tracker_without_an_arm_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracker, "WAIT_S", 0.0)
    assert "no simulated arm; start it first" in stderr_of(tmp_path / "so101", 5999, 1, program=tracker.main)


@pytest.mark.slow
def test_it_outlives_the_shell_and_says_farewell(tmp_path: Path) -> None:
    """Started by a shell that ends at once; LeRobot's file is written beside."""
    link, log = tmp_path / "so101", tmp_path / "log"
    started = f"{sys.executable} -m examples.so101 {link} gain 1 --calibration {tmp_path}/cal/mine.json"
    words = f"{started} > {log} 2>&1 & echo $!"
    number = subprocess.run(["sh", "-c", words], capture_output=True, text=True, check=True).stdout.strip()
    try:
        for _ in range(600):
            if log.exists() and "simulated SO-101 at" in log.read_text():
                break
            time.sleep(0.1)
        time.sleep(1.5)
        assert link.exists()
    finally:
        subprocess.run(["kill", number], check=True)
    for _ in range(600):
        if "ended" in log.read_text():
            break
        time.sleep(0.1)
    assert log.read_text().splitlines()[-1] == f"simulated SO-101 at {link} ended"
    assert not link.exists()
    motors = json.loads((tmp_path / "cal" / "mine.json").read_text())
    assert motors["gripper"] == {"id": 6, "drive_mode": 0, "homing_offset": 0, "range_min": 0, "range_max": 4095}
    assert next(iter(motors)) == "shoulder_pan"
