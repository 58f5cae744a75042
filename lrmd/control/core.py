"""The daemon's mind, without zenoh, clock or processes: requests and reports in; replies, orders and events out.

Everything that moves a servo begins with a request, with two exceptions that DESIGN asks for and an event announces:
a servo that gets too hot sends the arm to its rest pose, and then stops the pulses.
"""

from __future__ import annotations

from lrmd.control import requests, updates
from lrmd.control.events import Done
from lrmd.control.state import Situation
from lrmd.messages.control import Message
from lrmd.ramp.shared_memory import Report


class Core(Situation):
    """The situation, and all that changes it. Not thread-safe: its owner keeps a lock."""

    def handle(self, request: Message, now: int) -> Done:
        """Carries out a request. Raises an `LrmError` if it cannot; then nothing has changed."""
        return requests.carry_out(self, request, now)

    def observe(self, report: Report, now: int) -> None:
        """Takes in what the ramp says."""
        updates.observe(self, report, now)

    def tick(self, now: int) -> None:
        """What happens because time passes. Leaves a sign of life in the order."""
        updates.tick(self, now)
