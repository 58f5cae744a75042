"""A wait during which the computer was suspended, or the program stopped, ends what was to move the arm after it."""

from __future__ import annotations

import time

import pytest

from lrm_ident.measuring.campaign.session import AWAY_S, RealClock
from lrm_math.errors import LrmError


@pytest.mark.parametrize(("away", "ends"), [(0.0, False), (AWAY_S - 1.0, False), (AWAY_S + 1.0, True), (3600.0, True)])
def test_nothing_goes_on_after_a_computer_was_suspended(
    monkeypatch: pytest.MonkeyPatch, away: float, ends: bool
) -> None:
    passed = [100.0]
    monkeypatch.setattr(time, "clock_gettime", lambda clock: passed[0] if clock == time.CLOCK_BOOTTIME else 0.0)
    monkeypatch.setattr(time, "sleep", lambda seconds: passed.__setitem__(0, passed[0] + seconds + away))
    if ends:
        with pytest.raises(LrmError, match=f"stood still for {away:.0f} s"):
            RealClock().sleep(5.0)
    else:
        RealClock().sleep(5.0)
