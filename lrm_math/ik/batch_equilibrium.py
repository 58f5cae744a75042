"""Equilibria of those poses of a batch that settle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_math.errors import NotSettled
from lrm_math.ik.linkage import Indices
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import TOLERANCE, Equilibrium, settle
from lrm_math.model.model import Model


def settled(
    model: Model, poses: Poses, start: Sequence[Number] | None = None, tolerance: float = TOLERANCE
) -> tuple[Equilibrium, Indices]:
    """Where the arm rests in the poses in which it does, and their rows; arguments as of `settle`."""
    rows = np.arange(len(poses))
    while True:
        try:
            some = poses.take(rows)
            begin = None if start is None else [_of(a, rows) for a in start]
            return settle(model, some, begin, tolerance), rows
        except NotSettled as error:
            names = some.names(np.arange(len(rows)))
            rows = rows[~np.isin(names, error.poses)]


def _of(amount: Number, rows: Indices) -> Number:
    """An amount in some poses; of one pose a float, as all that is reckoned for one pose alone."""
    if isinstance(amount, float):
        return amount
    return float(amount[rows[0]]) if len(rows) == 1 else amount[rows]
