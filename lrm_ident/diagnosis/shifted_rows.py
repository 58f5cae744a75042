"""Shifted rows: blocks of rows that carry the position of a neighbouring row, as from a log that lost one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array

SHIFTS = (1, -1)
FEWEST = 2  # rows of a block: one alone may come near its neighbour's position by chance


@dataclass(frozen=True)
class ShiftedRows:
    """Consecutive poses, by number, whose position fits the pose `shift` rows before (−1: after) and not their own."""

    first: int
    last: int
    shift: int


def shifted_rows(pose: NDArray[np.int64], measured: Array, predicted: Array, limit: float) -> tuple[ShiftedRows, ...]:
    """Blocks of rows whose position is within a limit (m) of the prediction for a neighbour, but not for themselves.

    Args:
        pose: (N,), numbers of the poses, in order. measured, predicted: (N, 3), m; NaN where not known.
    """
    far = np.linalg.norm(measured - predicted, axis=1) > limit
    shifts = []
    for shift in SHIFTS:
        neighbour = np.full_like(predicted, np.nan)
        rows = np.arange(max(shift, 0), len(pose) + min(shift, 0))
        neighbour[rows] = predicted[rows - shift]
        fits = far & (np.linalg.norm(measured - neighbour, axis=1) < limit)
        shifts += [ShiftedRows(int(pose[a]), int(pose[b]), shift) for a, b in _runs(fits) if b - a + 1 >= FEWEST]
    return tuple(sorted(shifts, key=lambda shifted: shifted.first))


def _runs(rows: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """First and last index of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rows.astype(int), [0]])))
    for first, end in edges.reshape(-1, 2).tolist():
        yield first, end - 1
