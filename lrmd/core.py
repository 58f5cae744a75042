"""The daemon's mind, without zenoh, clock or processes: requests and reports in; replies, orders and events out.

Everything that moves a servo begins with a request, with two exceptions that DESIGN asks for and an event announces:
a servo that gets too hot sends the arm to its rest pose, and then stops the pulses.
"""

from __future__ import annotations

from lrmd import asked, unasked
from lrmd.happenings import Done
from lrmd.mailbox import Report
from lrmd.messages import Message
from lrmd.situation import Situation


class Core(Situation):
    """The situation, and all that changes it. Not thread-safe: its owner keeps a lock."""

    def handle(self, request: Message, now: int) -> Done:
        """Carries out a request. Raises an `LrmError` if it cannot; then nothing has changed."""
        return asked.carry_out(self, request, now)

    def observe(self, report: Report, now: int) -> None:
        """Takes in what the ramp says."""
        unasked.observe(self, report, now)

    def tick(self, now: int) -> None:
        """What happens because time passes. Leaves a sign of life in the order."""
        unasked.tick(self, now)
