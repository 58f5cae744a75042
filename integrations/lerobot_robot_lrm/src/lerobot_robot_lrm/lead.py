"""How far a moving joint is commanded ahead of its wish, so that it is not late by the dead time of its servo.

Nobody knows the next wishes. They are extrapolated from the last ones, by no more than the slower of their last two
rates times the dead time (minmod limiter; Roe 1986), and no farther than where a joint that slows down will stop. A
lead that shrinks does not turn the command back while the wish goes on: up to the faster of the two rates times the
dead time, the command waits for the wish.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lerobot_robot_lrm.wish_times import times_of_even_motion
from lrm_math.arrays import Array

SPAN_S = 0.025
"""Over which a rate is measured at least: one frame at 30 a second, two at 60."""
ROUNDING_S = 1e-9
TREMOR = 1.5 * 2.0 * math.pi / 4096.0
"""rad: a leader's encoder that flickers by one step is not led."""
LONGEST_GAP_S = 6.0 * SPAN_S
"""Between two wishes of a stream of 10 a second, one of them half a frame late; what comes later begins anew, so that
single goals are not led."""
MEMORY_S = 10.0 * SPAN_S
"""Of the wishes whose pace is judged."""
FARTHEST_LEAD = math.radians(6.0)
MOST_WISHES = 64
"""That are remembered: two spans at up to 1200 a second."""


@dataclass(frozen=True, eq=False)
class Lead:
    """Wishes that came last, and the dead times (n,), s, by which the joints are led.

    Attributes:
        times: (N,), s, at which the wishes came, rising. wishes: (N, n), rad.
        ahead: (n,), rad, by which the joints are commanded ahead of the last wish. Zero where a joint rests, turns
            round, or has just begun to move.
    """

    dead_time: Array
    times: Array
    wishes: Array
    ahead: Array

    @classmethod
    def of(cls, dead_time: Array) -> Lead:
        """Before the first wish."""
        return cls(dead_time, np.empty(0), np.empty((0, len(dead_time))), np.zeros_like(dead_time))

    def after(self, wish: Array, now: float) -> Lead:
        """The lead once another wish (n,), rad, has come, at a time (s)."""
        if not len(self.times) or now - self.times[-1] > LONGEST_GAP_S:
            return replace(Lead.of(self.dead_time), times=np.array([now]), wishes=wish[None])
        kept = np.flatnonzero((self.times >= now - MEMORY_S) & (self.times < now))[1 - MOST_WISHES :]
        times, wishes = np.append(self.times[kept], now), np.vstack([self.wishes[kept], wish])
        return Lead(self.dead_time, times, wishes, self._ahead(times, wishes))

    def _ahead(self, times: Array, wishes: Array) -> Array:
        """(n,), rad, ahead of the last of wishes (N, n), rad."""
        made = times_of_even_motion(times, wishes)
        last = len(made) - 1
        middle = _a_span_before(made, last)
        first = _a_span_before(made, middle)
        if first < 0:
            return np.zeros_like(self.dead_time)
        (t0, t1, t2), (q0, q1, q2) = made[[first, middle, last]], wishes[[first, middle, last]]
        before, rate = (q1 - q0) / (t1 - t0), (q2 - q1) / (t2 - t1)
        way, goes_on = np.sign(rate), before * rate > 0.0
        moves = np.minimum(np.abs(q1 - q0), np.abs(q2 - q1)) > TREMOR
        led = np.where(moves, np.abs(_extrapolated(before, rate, t2 - t1, t2 - t0, self.dead_time)), 0.0)
        waits = np.where(way * (q2 - self.wishes[-1]) > 0.0, way * (self.wishes[-1] + self.ahead - q2), 0.0)
        faster = np.maximum(np.abs(before), np.abs(rate)) * self.dead_time
        led = np.maximum(led, np.minimum(waits, faster))
        return np.where(goes_on, way * np.minimum(led, FARTHEST_LEAD), 0.0)


def _a_span_before(times: Array, number: int) -> int:
    """Number of the newest of times (N,), s, that is a span older than one of a number; −1: there is none."""
    if number <= 0:
        return -1
    return int(np.searchsorted(times[:number], times[number] - SPAN_S + ROUNDING_S, side="right")) - 1


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
