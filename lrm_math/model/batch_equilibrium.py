"""Equilibria of a batch of poses, those that do not settle left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import TOLERANCE, Equilibrium, equilibrium
from lrm_math.model.fixed_point import amounts_at
from lrm_math.model.model import Model


def batch_equilibrium(
    model: Model, poses: Poses, start: Sequence[Number] | None = None, tolerance: float = TOLERANCE
) -> tuple[Equilibrium, NDArray[np.int64]]:
    """Equilibria of the poses that settle, and their rows; arguments as of `equilibrium`."""
    rows = np.arange(len(poses))
    while True:
        try:
            some = poses.take(rows)
            begin = None if start is None else [amounts_at(a, rows) for a in start]
            return equilibrium(model, some, begin, tolerance), rows
        except NoEquilibrium as error:
            names = some.names(np.arange(len(rows)))
            rows = rows[~np.isin(names, error.poses)]
