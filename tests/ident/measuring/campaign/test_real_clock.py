"""A wait during which the computer was suspended, or the program stopped, ends what was to move the arm after it."""

from __future__ import annotations

import time

import pytest

from lrm_ident.measuring.campaign.session import AWAY_S, RealClock
from lrm_math.errors import LrmError

AWAY = [(0.0, False), (AWAY_S - 1.0, False), (AWAY_S + 1.0, True), (3600.0, True)]
"""s away, and whether that ends it."""


class Computer:
    """Its clocks (s): monotonic time does not pass while it is suspended."""

    def __init__(self) -> None:
        self.monotonic, self.suspended, self.stopped = 100.0, 0.0, 0.0

    def waits(self, seconds: float) -> None:
        self.monotonic += seconds + self.stopped


@pytest.fixture
def computer(monkeypatch: pytest.MonkeyPatch) -> Computer:
    made = Computer()
    both = {time.CLOCK_BOOTTIME: lambda: made.monotonic + made.suspended}
    monkeypatch.setattr(time, "clock_gettime", lambda clock: both[clock]())
    monkeypatch.setattr(time, "monotonic", lambda: made.monotonic)
    monkeypatch.setattr(time, "sleep", made.waits)
    return made


@pytest.mark.parametrize(("away", "ends"), AWAY)
def test_nothing_goes_on_after_a_program_was_stopped_while_it_slept(
    computer: Computer, away: float, ends: bool
) -> None:
    clock, computer.stopped = RealClock(), away
    if ends:
        with pytest.raises(LrmError, match=f"stood still for {away:.0f} s"):
            clock.sleep(5.0)
    else:
        clock.sleep(5.0)


@pytest.mark.parametrize(("away", "ends"), AWAY)
def test_nothing_goes_on_after_a_computer_was_suspended_whatever_it_waited_for(
    computer: Computer, away: float, ends: bool
) -> None:
    """A tracker's frames are waited for without this clock; before a motion it is asked for the time."""
    clock = RealClock()
    clock.sleep(5.0)
    computer.suspended += away
    if ends:
        with pytest.raises(LrmError, match=f"stood still for {away:.0f} s"):
            clock.now()
    else:
        assert clock.now() == computer.monotonic
