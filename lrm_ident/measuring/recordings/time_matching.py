"""Rests of the tip and poses that belong together, by their times of two clocks, where some of either are missing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array

Rows = NDArray[np.int64]


def rows_of_same_time(rests: Array, poses: Array, tolerance: float) -> tuple[Rows, Rows] | None:
    """Rows of rests and of poses, ascending, whose times (M,), (N,), s, agree within a tolerance but for a constant.

    Every row of the shorter of the two has its partner. None where no constant does that, or several do it with other
    partners: at regular times it is not known at which end the missing ones were.
    """
    if len(rests) < len(poses):
        matched = rows_of_same_time(poses, rests, tolerance)
        return None if matched is None else matched[::-1]
    ways: dict[bytes, Rows] = {}
    for shift in rests[: len(rests) - len(poses) + 1] - poses[0]:
        off = np.abs(rests - (poses[:, None] + shift))
        rows = off.argmin(axis=1)
        if (off.min(axis=1) <= tolerance).all() and (np.diff(rows) > 0).all():
            ways[rows.tobytes()] = rows
    if len(ways) != 1:
        return None
    (rows,) = ways.values()
    return rows, np.arange(len(poses))
