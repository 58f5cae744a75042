"""The arm controller without input and output: requests and ramp reports in; results, orders and events out.

Servos move only on request, with one exception that an event announces: thermal protection (`thermal_protection.py`).
"""

from __future__ import annotations

from lrmd.control import requests, updates
from lrmd.control.state import ControllerState


class Controller(ControllerState):
    """The state and every operation on it; all times are monotonic ns. Not thread-safe: its owner keeps a lock."""

    handle = requests.handle
    observe = updates.observe
    tick = updates.tick
    others_seen = updates.others_seen
    adopt_guard = updates.adopt_guard
