"""Influential poses (Belsley, Kuh & Welsch 1980): those that alone determine the model where they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_ident.fitting.levenberg_marquardt import OUTLIER_DISTANCE
from lrm_ident.fitting.loss import robust_scale
from lrm_math.arrays import Array

MOST_OF_ERROR = 0.5
"""Share of the squared held-out error that such poses hold, at least, to be reported."""


@dataclass(frozen=True)
class InfluentialPoses:
    """Rows of such poses, the farthest predicted first; by how far (m), and the RMS of all other poses (m)."""

    rows: tuple[int, ...]
    distances: tuple[float, ...]
    others: float


def influential_poses(residual: Array, held_out: Array) -> InfluentialPoses | None:
    """Poses far from their prediction by a fit without them, and near by the fit with them; None if there are none.

    Such a pose is no wrong measurement, as the model describes it, but no other pose shows what the model has there.
    None unless these poses hold most of the squared held-out error.

    Args:
        residual, held_out: (N, 3), m, of the fit to all poses, and cross-validated.
    """
    fitted, predicted = (np.linalg.norm(each, axis=1) for each in (residual, held_out))
    limit = OUTLIER_DISTANCE * robust_scale(predicted)
    rows = np.flatnonzero((predicted > limit) & (fitted <= limit))
    squares = np.square(predicted)
    if not len(rows) or squares[rows].sum() <= MOST_OF_ERROR * squares.sum():
        return None
    rows = rows[np.argsort(-predicted[rows])]
    others = float(np.sqrt(np.delete(squares, rows).mean()))
    return InfluentialPoses(tuple(rows.tolist()), tuple(predicted[rows].tolist()), others)
