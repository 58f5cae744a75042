"""Rests of the arm in a recording: at regular times, or wherever the tip stood still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.errors import LrmError

STILL_M = 1e-3
"""m: how far the tip may be from where it is one dwell later; more than noise and sag, less than any move."""
END_S = 0.1
"""s before a rest ends that are not used: the next move may have begun."""
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class RestTimes:
    """Regular rests: the first one ends at `first` s of the recording, the others every `every` s."""

    first: float
    every: float

    def ends(self, count: int) -> Array:
        """(count,), end of each rest (s)."""
        return np.asarray(self.first + self.every * np.arange(count))


def regular_rests(t: Array, count: int, times: RestTimes, dwell: float) -> list[Rows]:
    """The frames of the last `dwell` s before the end of each of `count` rests; t: (N,), s from the first frame.

    Raises `LrmError` if the recording ends before.
    """
    ends = times.ends(count)
    if not len(t) or ends[-1] > t[-1] + dwell:
        last = float(t[-1]) if len(t) else 0.0
        raise LrmError(f"the last of {count} rests would end at {ends[-1]:.1f} s, the recording ends at {last:.1f} s")
    return [np.flatnonzero((t > end - dwell) & (t <= end)) for end in ends]


def still_rests(t: Array, tip: Array, dwell: float) -> list[Rows]:
    """The frames of the last `dwell` s of every stretch of at least twice that in which the tip (N, 3) stands still."""
    seen = np.flatnonzero(np.isfinite(tip).all(axis=1))
    if not len(seen):
        return []
    later = np.searchsorted(t[seen], t[seen] + dwell, side="right") - 1
    moved = np.linalg.norm(tip[seen[later]] - tip[seen], axis=1)
    lasting = t[seen[later]] - t[seen] > 0.5 * dwell
    stands = (moved < STILL_M) & lasting
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]]).astype(np.int64)))
    rests = []
    for begin, end in zip(edges[0::2], edges[1::2], strict=True):
        first, last = t[seen[begin]], t[seen[later[end - 1]]] - END_S
        if last - first >= 2.0 * dwell:
            rests.append(np.flatnonzero((t > last - dwell) & (t <= last)))
    return rests


def check_number(rests: Sequence[Rows], poses: int, skip: int) -> Sequence[Rows]:
    """The rests after the first `skip`, one for each pose. Raises `LrmError` if there are more or fewer."""
    left = rests[skip:]
    if len(left) != poses:
        raise LrmError(
            f"the tip rests {len(rests)} times{f', {skip} of them skipped' if skip else ''}, there are {poses} poses; "
            "give --skip for rests before the first pose, or --every and --first for rests at regular times"
        )
    return left
