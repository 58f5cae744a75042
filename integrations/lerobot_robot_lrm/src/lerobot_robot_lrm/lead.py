"""How far a moving joint is commanded ahead of its wish, so that it is not late by the dead time of its servo.

Nobody knows the next wishes. They are extrapolated from the last ones, by no more than the slower of their last two
rates times the dead time (minmod limiter; Roe 1986), and no farther than where a joint that slows down will stop.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from lrm_math.arrays import Array

SPAN_S = 0.025
"""Over which a rate is measured at least: one frame at 30 a second, two at 60."""
TREMOR = 1.5 * 2.0 * math.pi / 4096.0
"""rad: a leader's encoder that flickers by one step is not led."""
LONGEST_GAP_S = 4.0 * SPAN_S
"""Between two wishes of a stream; what comes later begins anew, so that single goals are not led."""
FARTHEST_LEAD = math.radians(6.0)
MOST_WISHES = 64
"""That are remembered: two spans at up to 1200 a second."""


@dataclass(frozen=True, eq=False)
class Lead:
    """Wishes that came last, and the dead times (n,), s, by which the joints are led.

    Attributes:
        recent: time (s) and angles (n,), rad, of each wish, the oldest first.
    """

    dead_time: Array
    recent: tuple[tuple[float, Array], ...] = ()

    def after(self, wish: Array, now: float) -> Lead:
        """The lead once another wish (n,), rad, has come, at a time (s)."""
        goes_on = self.recent and now - self.recent[-1][0] <= LONGEST_GAP_S
        earlier = tuple(one for one in self.recent if one[0] < now) if goes_on else ()
        return replace(self, recent=(*earlier, (now, wish))[-MOST_WISHES:])

    def ahead(self) -> Array:
        """(n,), rad, by which the joints are commanded ahead of the last wish.

        Zero where a joint rests, turns round, or has just begun to move.
        """
        last = len(self.recent) - 1
        middle = self._before(last)
        first = self._before(middle)
        if first < 0:
            return np.zeros_like(self.dead_time)
        (t0, q0), (t1, q1), (t2, q2) = (self.recent[k] for k in (first, middle, last))
        led = _extrapolated((q1 - q0) / (t1 - t0), (q2 - q1) / (t2 - t1), t2 - t1, t2 - t0, self.dead_time)
        moves = ((q1 - q0) * (q2 - q1) > 0.0) & (np.minimum(np.abs(q1 - q0), np.abs(q2 - q1)) > TREMOR)
        return np.clip(np.where(moves, led, 0.0), -FARTHEST_LEAD, FARTHEST_LEAD)

    def _before(self, number: int) -> int:
        """The newest wish that is a span older than one of a number; −1: there is none."""
        if number <= 0:
            return -1
        return bisect_right(self.recent, self.recent[number][0] - SPAN_S, hi=number, key=itemgetter(0)) - 1


def _extrapolated(before: Array, rate: Array, span: float, both: float, dead_time: Array) -> Array:
    """(n,), rad, that joints go on within dead times (n,), s, by their last two rates (n,), rad/s.

    Where a joint slows down: by the parabola through the three points (Newton's divided differences), to its vertex at
    most. Elsewhere at the slower rate, that before.

    Args:
        span, both: s, from the second point to the last, and from the first.
    """
    slows = np.abs(rate) < np.abs(before)
    bend = np.where(slows, (rate - before) / both, 0.0)
    vertex = np.where(slows, -0.5 * (rate / np.where(slows, bend, 1.0) + span), dead_time)
    passed = np.clip(vertex, 0.0, dead_time)
    return np.asarray(passed * np.where(slows, rate, before) + bend * passed * (passed + span))
