"""A board whose oscillator is off by 8 %: `lrm level1 --clock` measures it, and the joints stand at 0 afterwards."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Callable, Collection
from pathlib import Path

import pytest

from lrmd.config import load_config
from tests.support.daemon.daemon_harness import HOME, arm_when_ready, connected
from tests.support.daemon.daemon_process import ROOT, BoardProcess, DaemonSetup, wait_for
from tests.support.daemon.pulse_invariants import read_frames

TRUE_HZ = 27e6
SHIPPED = {"pwm_hz = 50.0": "pwm_hz = 50.0", "step_us = 1.0": "step_us = 10.0"}
"""The shipped frequency in place of that of the tests: its counts are the longest. And ten times the speed."""
COUNT_DEG, FULL_PULSE_DEG = 0.55, 175.0
"""deg that a count of 4.88 us, and a pulse as long as that of 0 deg, turn a servo: the latter is off by the clock."""


class Operator:
    """Somebody at the terminal of `lrm level1 SERVO --clock`. `heard`: all that it printed."""

    def __init__(self, setup: DaemonSetup, servo: str) -> None:
        lrm = Path(sys.executable).with_name("lrm")
        command = [str(lrm), "--connect", setup.endpoint, "level1", servo, "--clock"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT)
        self.heard = ""

    def asked(self, question: str) -> None:
        """Waits for a question."""
        assert self._process.stdout is not None
        known = len(self.heard)
        while question not in self.heard[known:]:
            letter = self._process.stdout.read(1)
            assert letter, f"no question '{question}' in: {self.heard}"
            self.heard += letter

    def answers(self, question: str, word: str) -> None:
        """Types a word once a question is asked."""
        self.asked(question)
        self._process.stdin.write(word + "\n")
        self._process.stdin.flush()

    def measured(self) -> tuple[float, float]:
        """Oscillator and uncertainty (Hz) that it prints at last."""
        self.heard += self._process.communicate(timeout=20)[0]
        found = re.search(r"oscillator: ([\d.]+) \+- ([\d.]+) MHz", self.heard)
        assert found, self.heard
        return float(found[1]) * 1e6, float(found[2]) * 1e6


def shafts(board: BoardProcess, names: Collection[str]) -> dict[str, float]:
    """Angles of these shafts (deg), once they do not turn any more; a joint without pulses may sink for long."""
    seen: list[dict[str, float]] = []

    def still() -> bool:
        joints = board.ask("joints")
        seen.append({name: float(joints[name]["angle_deg"]) for name in names})  # type: ignore[index]
        return len(seen) > 1 and max(abs(seen[-1][name] - seen[-2][name]) for name in seen[-1]) < 0.01

    wait_for(still, "the shafts stand still", pause=0.2)
    return seen[-1]


def by_probe(setup: DaemonSetup, board: BoardProcess) -> Operator:
    """A logic probe that shows whole us, at the gripper's pin."""
    operator = Operator(setup, "gripper")
    operator.answers("Angle where it stands", "0")
    operator.answers("ENTER: switch it on", "")
    operator.asked("measured >")
    wait_for(lambda: bool(board.pulses()), "the board puts the pulse out")
    operator.answers("", f"{board.pulses()[0]:.0f}us")
    return operator


def by_protractor(setup: DaemonSetup, board: BoardProcess) -> Operator:
    """A protractor on joint 1 that is read to a degree, and whose zero is elsewhere."""
    operator = Operator(setup, "joint1")
    operator.answers("Angle where it stands", "0")
    operator.answers("ENTER: switch it on", "")
    operator.answers("measured >", "")
    for wanted in ("-40", "40"):
        operator.answers("angles to turn", wanted)
        operator.asked("the protractor shows")
        operator.answers("", f"{shafts(board, ['joint1'])['joint1'] + 7.0:.0f}")
    return operator


def pulsed_channels(setup: DaemonSetup) -> set[int]:
    """Channels that ever had a pulse."""
    return {channel for line in read_frames(setup.log) for channel, count in line.counts.items() if count}


@pytest.mark.parametrize(("way", "number"), [(by_probe, 6), (by_protractor, 0)])
def test_the_clock_is_measured_before_arming_and_joints_stand_at_zero(
    tmp_path: Path, way: Callable[[DaemonSetup, BoardProcess], Operator], number: int
) -> None:
    setup = DaemonSetup.make(tmp_path, SHIPPED)
    with BoardProcess(setup, "--osc-hz", f"{TRUE_HZ:g}", "--seed", "57") as board:
        with connected(setup):
            operator = way(setup, board)
            hz, uncertainty = operator.measured()
        assert pulsed_channels(setup) == {load_config(setup.config).servos[number].channel}, "no other servo has pulses"
        assert hz == pytest.approx(TRUE_HZ, abs=uncertainty)
        line = re.search(r"oscillator_hz = \S+", operator.heard)
        assert line, operator.heard
        text = setup.config.read_text(encoding="utf-8")
        setup.config.write_text(re.sub(r"oscillator_hz = \S+", line[0], text), encoding="utf-8")
        time.sleep(1.2)  # `silence_ms`: the board stops its pulses
        with connected(setup) as (_, rover), rover.control("operator"):
            arm_when_ready(rover, "given", HOME)
            allowed = COUNT_DEG + FULL_PULSE_DEG * abs(hz / TRUE_HZ - 1)
            assert {n: q for n, q in shafts(board, HOME).items() if abs(q) > allowed} == {}
