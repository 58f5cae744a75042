"""Where the computer was suspended, or the program stopped, what was to move the arm after it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from lrm_ident.measuring.campaign import real_clock
from lrm_ident.measuring.campaign.real_clock import AWAY_S, RealClock
from lrm_math.errors import LrmError

AWAY = [(0.0, False), (AWAY_S - 1.0, False), (AWAY_S + 1.0, True), (3600.0, True)]
"""s away, and whether that ends it."""
CHILD = """\
from lrm_ident.measuring.campaign import real_clock
real_clock.AWAY_S = 1.0
clock = real_clock.RealClock()
print("begun", flush=True)
input()  # as a tracker's frames: nothing that asks the clock
clock.now()
"""


class Computer:
    """Its clocks (s): monotonic time does not pass while it is suspended. `stopped`: in the middle of the next wait."""

    def __init__(self) -> None:
        self.monotonic, self.suspended, self.stopped = 100.0, 0.0, 0.0

    def waits(self, seconds: float) -> None:
        self.monotonic += seconds + self.stopped
        self.stopped = 0.0


@pytest.fixture
def computer(monkeypatch: pytest.MonkeyPatch) -> Computer:
    made = Computer()
    both = {time.CLOCK_BOOTTIME: lambda: made.monotonic + made.suspended}
    monkeypatch.setattr(time, "clock_gettime", lambda clock: both[clock]())
    monkeypatch.setattr(time, "monotonic", lambda: made.monotonic)
    monkeypatch.setattr(time, "sleep", made.waits)
    return made


@pytest.mark.parametrize(("away", "ends"), AWAY)
def test_nothing_goes_on_after_the_program_was_stopped(computer: Computer, away: float, ends: bool) -> None:
    clock, computer.stopped = RealClock(), away
    if ends:
        with pytest.raises(LrmError, match="stood still for"):
            clock.sleep(15.0)
    else:
        clock.sleep(15.0)
        assert clock.now() >= 115.0


@pytest.mark.parametrize(("away", "ends"), AWAY)
def test_nothing_goes_on_after_the_computer_was_suspended(computer: Computer, away: float, ends: bool) -> None:
    """A tracker's frames are waited for without this clock; before a motion it is asked for the time."""
    clock = RealClock()
    clock.sleep(5.0)
    computer.suspended += away
    if ends:
        with pytest.raises(LrmError, match=f"stood still for {away:.0f} s"):
            clock.now()
    else:
        assert clock.now() == computer.monotonic


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="no SIGSTOP here")
def test_nothing_goes_on_after_a_program_was_stopped_while_it_waited_for_something_else() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", CHILD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        child.stdout.readline()
        os.kill(child.pid, signal.SIGSTOP)
        time.sleep(2.0)
        os.kill(child.pid, signal.SIGCONT)
        _, error = child.communicate("\n", timeout=60)
    assert "stood still for" in error
    assert child.returncode != 0


def test_a_wait_for_something_else_is_no_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread looks meanwhile; without it this wait would be a time in which the program stood still."""
    monkeypatch.setattr(real_clock, "LOOK_S", 0.01)
    clock, seen = RealClock(), 0
    look = clock.look

    def counted() -> float:
        nonlocal seen
        seen += 1
        return look()

    monkeypatch.setattr(clock, "look", counted)
    while seen < 3:
        real_clock.threading.Event().wait(0.01)
    assert clock.now() > 0.0
