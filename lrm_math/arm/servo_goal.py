"""Goal of a bus servo that gets torque: where it stands, so that nothing turns. Counts, 4096 a turn."""

from __future__ import annotations

import math

from lrm_math.errors import LrmError

STEP = 2.0 * math.pi / 4096.0
"""rad for one count."""
MIDDLE = 2048
MOST_SWAY = 11
"""Counts, a degree: a joint that stands further beyond its servo's limits gets no torque."""


def standing_goal(joint: str, at: int, least: int, greatest: int) -> int:
    """The goal (counts) at which a servo that stands at a count does not move, by its own limits.

    Raises `LrmError`: it would turn to within them.
    """
    goal = min(max(at, least), greatest)
    if abs(goal - at) > MOST_SWAY:
        stands, low, high = (math.degrees((n - MIDDLE) * STEP) for n in (at, least, greatest))
        off = math.degrees(abs(goal - at) * STEP)
        raise LrmError(
            f"{joint} stands at {stands:.1f} deg, {off:.1f} deg beyond its servo's own limits, {low:.0f} to "
            f"{high:.0f} deg: with torque it would turn there at once; move it by hand to within them"
        )
    return goal
