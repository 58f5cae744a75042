"""Distances from line segments to a heightfield: columns on a grid, each solid up to its height and without end below.

The distance is exact for the columns, so it changes no faster than the segment moves, and its curvature is bounded as
that of a box is. A quadtree with the largest height of every node finds it: a node is left out where a column that the
segment is over is nearer (branch and bound, Samet 1984). Lengths in m, in the frame of the grid, whose first column
begins at the origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.collision.distance import segment_to_box

Indices = NDArray[np.intp]
BELOW = 100.0
"""m: how far a column goes down in the computation; farther than anything that is asked about."""
FAR = 0.3
"""m: beyond it a distance is not computed; that much is more than any margin."""
POINTS = 17
"""Points along a segment in which its depth is computed."""
COARSE = 16
"""Rows and columns of the coarse heights, in which the depth is computed."""
BATCH = 4096
"""Segments or points at once."""


@dataclass(frozen=True, eq=False)
class HeightGrid:
    """Columns of `heights` (R, C), m, row by row along y and along x in a row, with edges of `cell` (m).

    Minus infinity: there is no column."""

    heights: Array
    cell: float

    @cached_property
    def _levels(self) -> list[Array]:
        """Largest height of every node, of the columns first: each level has half the rows and columns of the last."""
        levels = [self.heights]
        while levels[-1].size > 1:
            rows, columns = levels[-1].shape
            padded = np.pad(levels[-1], ((0, rows % 2), (0, columns % 2)), constant_values=-np.inf)
            levels.append(padded.reshape((rows + 1) // 2, 2, (columns + 1) // 2, 2).max(axis=(1, 3)))
        return levels

    def distance(self, a: Array, b: Array) -> Array:
        """(N,), least distance of segments a-b, each (N, 3), to the columns: 0 if they intersect, at most `FAR`."""
        return np.concatenate([self._distance(a[i : i + BATCH], b[i : i + BATCH]) for i in range(0, len(a), BATCH)])

    def _distance(self, a: Array, b: Array) -> Array:
        least = self._beneath(a, b)
        lowest, highest = np.minimum(a, b), np.maximum(a, b)
        segment = np.flatnonzero(least > 0.0)
        row = column = np.zeros(len(segment), dtype=np.intp)
        for level in range(len(self._levels) - 1, -1, -1):
            heights, size = self._levels[level], self.cell * 2**level
            there = (row < heights.shape[0]) & (column < heights.shape[1])
            segment, row, column = segment[there], row[there], column[there]
            # a node is at least as far as from the box around the segment
            x = np.maximum(column * size - highest[segment, 0], lowest[segment, 0] - (column + 1) * size)
            y = np.maximum(row * size - highest[segment, 1], lowest[segment, 1] - (row + 1) * size)
            z = lowest[segment, 2] - heights[row, column]
            near = sum(np.maximum(gap, 0.0) ** 2 for gap in (x, y, z)) < least[segment] ** 2
            segment, row, column = segment[near], row[near], column[near]
            if level:
                segment = np.repeat(segment, 4)
                row = np.repeat(2 * row, 4) + np.tile([0, 0, 1, 1], len(row))
                column = np.repeat(2 * column, 4) + np.tile([0, 1, 0, 1], len(column))
        np.minimum.at(least, segment, self._to_column(a[segment], b[segment], row, column))
        return least

    def _beneath(self, a: Array, b: Array) -> Array:
        """(N,), no less than the distance of segments: the least height of some of their points above the columns that
        they are over, or `FAR`."""
        along = np.linspace(0.0, 1.0, POINTS)[:, None]
        points = a[:, None] + along * (b - a)[:, None]
        above = np.maximum(points[..., 2] - self._over(points)[0], 0.0)
        return np.asarray(np.minimum(above.min(axis=1), FAR))

    def _over(self, points: Array) -> tuple[Array, Array]:
        """(…), height of the column that points (…, 3) are over, minus infinity without one; distance to its sides."""
        at = points[..., :2] / self.cell
        cell = np.floor(at)
        sides = self.cell * np.minimum(at - cell, cell + 1.0 - at).min(axis=-1)
        rows, columns = self.heights.shape
        there = ((cell >= 0.0) & (cell < (columns, rows))).all(axis=-1)
        column, row = (np.where(there, cell[..., axis], 0.0).astype(np.intp) for axis in (0, 1))
        return np.where(there, self.heights[row, column], -np.inf), sides

    def _to_column(self, a: Array, b: Array, row: Indices, column: Indices) -> Array:
        """(M,), distances of segments (M, 3) to columns."""
        high = self.heights[row, column]
        low = -BELOW + min(0.0, float(high.min(initial=0.0)))
        across = np.full(len(high), 0.5 * self.cell)
        half = np.stack([across, across, 0.5 * (high - low)], axis=-1)
        centre = np.stack([(column + 0.5) * self.cell, (row + 0.5) * self.cell, 0.5 * (high + low)], axis=-1)
        return segment_to_box(a - centre, b - centre, half)

    def depth(self, a: Array, b: Array) -> Array:
        """(N,), how deep segments a-b, each (N, 3), are in the columns, m: of the deepest of some of their points.

        It changes no faster than a segment moves, is 0 outside and no more than the distance to what no column fills:
        the larger of the depth in the column that a point is in, and of that in `_coarse` columns inside these.
        """
        along = np.linspace(0.0, 1.0, POINTS)[:, None]
        points = (a[:, None] + along * (b - a)[:, None]).reshape(-1, 3)
        depths = [self._point_depth(points[i : i + BATCH]) for i in range(0, len(points), BATCH)]
        return np.asarray(np.concatenate(depths).reshape(-1, POINTS).max(axis=1, initial=0.0))

    def _point_depth(self, points: Array) -> Array:
        """(P,), of points (P, 3)."""
        high, sides = self._over(points)
        in_column = np.maximum(np.minimum(high - points[:, 2], sides), 0.0)
        heights, cell = self._coarse
        rows, columns = heights.shape
        across = [_beyond(points[:, axis], cell, count) for axis, count in ((1, rows), (0, columns))]
        up = np.maximum(heights[None] - points[:, 2, None, None], 0.0)
        squared = across[0][:, :, None] ** 2 + across[1][:, None, :] ** 2 + up**2
        return np.asarray(np.maximum(in_column, np.sqrt(squared.reshape(len(points), -1).min(axis=1))))

    @cached_property
    def _coarse(self) -> tuple[Array, float]:
        """Heights of wider columns that lie inside these, `COARSE` each way at most, in a ring of cells without one;
        their edge (m)."""
        step = -(-max(self.heights.shape) // COARSE)
        padded = np.pad(self.heights, [(0, -count % step) for count in self.heights.shape], constant_values=-np.inf)
        rows, columns = (count // step for count in padded.shape)
        least = padded.reshape(rows, step, columns, step).min(axis=(1, 3))
        return np.pad(least, 1, constant_values=-np.inf), step * self.cell


def _beyond(x: Array, cell: float, count: int) -> Array:
    """(P, count), distance of coordinates (P,) to the intervals of a ringed row of cells; the outermost have no end."""
    low = cell * np.arange(-1.0, count - 1.0)
    high = low + cell
    low[0], high[-1] = -np.inf, np.inf
    return np.asarray(np.maximum(np.maximum(low - x[:, None], x[:, None] - high), 0.0))
