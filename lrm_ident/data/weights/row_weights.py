"""Relative weights of the rows of a fit: by their stated noise, correlations included, and the loss of the fit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lrm_ident.data.weights.whitening import Whitening
from lrm_math.arrays import Array


@dataclass(frozen=True, eq=False)
class RowWeights:
    """Weights of R rows of each of N poses, of mean square near one. `loss`: (N,), weight of each pose in the fit."""

    whitening: Whitening
    loss: Array

    @cached_property
    def _each(self) -> Array:
        """(3 N, 1), of positions that are alike along all axes."""
        sd = self.whitening.sd
        known = np.ones(len(self.loss)) if sd is None else self.whitening.unit / sd
        return np.repeat(known * np.sqrt(self.loss), 3)[:, None]

    def __call__(self, columns: Array) -> Array:
        """Weighted columns (R N, m)."""
        if self.whitening.root is None:
            return columns * self._each
        rows = columns.reshape(len(self.loss), len(columns) // len(self.loss), columns.shape[1])  # no column, too
        weight = self.whitening.unit * np.sqrt(self.loss)[:, None, None]
        return (self.whitening(rows) * weight).reshape(columns.shape)

    def positions(self, rows: Array) -> Array:
        """(N, 3), the positions (m) of weighted rows (R N,)."""
        if self.whitening.root is None:
            return (rows[:, None] / self._each).reshape(-1, 3)
        weight = self.whitening.unit * np.sqrt(self.loss)[:, None]
        return self.whitening.undone(rows.reshape(len(self.loss), -1) / weight)
