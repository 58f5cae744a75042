"""Times of wishes that a loop passes on too early or too late: as they came, or at an even pace."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array


def times_of_even_motion(came: Array, wishes: Array) -> Array:
    """(N,), s, as they came or evenly spaced in the same time, whichever the motion is more even by.

    A policy makes its wishes for an even pace, and the loop that sends them is not punctual. A leader arm is read at
    the moment of the loop itself. The motion tells which: by the right times each wish is nearer to the straight line
    between its neighbours. A loop that is a whole period off has no even pace.

    Args:
        came: (N,), s, rising. wishes: (N, n), rad.
    """
    even = np.linspace(came[0], came[-1], len(came))
    if len(came) < 3 or np.abs(came - even).max() > even[1] - even[0]:
        return came
    by_pace, by_clock = _bend(even, wishes), _bend(came, wishes)
    both = by_pace + by_clock
    moves = both > 0.0
    # relative to each joint: one that really bends its way is as uneven by either, and must not outweigh the others
    return even if (by_pace[moves] / both[moves]).sum() < 0.5 * np.count_nonzero(moves) else came


def _bend(times: Array, wishes: Array) -> Array:
    """(n,), rad², squared distances of wishes (N, n) from the straight lines between their neighbours."""
    before, after = (times[1:-1] - times[:-2])[:, None], (times[2:] - times[1:-1])[:, None]
    between = (wishes[:-2] * after + wishes[2:] * before) / (before + after)
    return np.asarray(np.square(wishes[1:-1] - between).sum(axis=0))
