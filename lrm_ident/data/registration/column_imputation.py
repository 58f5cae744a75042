"""Imputation of one column of measurements from all the others (Little & Rubin 2002), by the arm as their regression.

Where what was read in the column may be another quantity.
"""

from __future__ import annotations

import numpy as np

from lrm_ident.data.registration.coarse_fit import coarse_fit
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of

GRID, TERNARY_STEPS, FITS = 48, 25, 2
"""Angles tried in a full turn, steps between two of them, and fits of the dimensions to an imputed coordinate."""


def imputed_angles(arm: Arm, poses: Poses, tcp: Array, joint: int) -> Array:
    """(N,), rad, angles of a joint (from 0) for which the arm comes nearest to positions (N, 3), m, all others as read.

    First of the arm as drawn, then of its dimensions that these angles lead to, unless such an arm would not settle.
    """
    first = _nearest(model_of(arm, ()), poses, tcp, joint)
    fitted = coarse_fit(arm, poses.perturbed(joint, first - poses.q[:, joint]), tcp)
    try:
        return _nearest(fitted.equilibrium.model, poses, tcp, joint)
    except NoEquilibrium:
        return first


def imputed_coordinate(arm: Arm, poses: Poses, tcp: Array, axis: int) -> Array:
    """(N,), m, one coordinate of positions (N, 3), from the angles and the other two coordinates."""
    tcp = tcp.copy()
    tcp[:, axis] = solve_equilibrium(model_of(arm, ()), poses).tcp[:, axis]
    for _ in range(FITS):
        tcp[:, axis] = coarse_fit(arm, poses, tcp).equilibrium.tcp[:, axis]
    return np.asarray(tcp[:, axis])


def _nearest(model: Model, poses: Poses, tcp: Array, joint: int) -> Array:
    """(N,), rad, the nearest of `GRID` angles in a full turn, then by ternary search between its neighbours."""

    def distance(angles: Array | float) -> Array:
        at = solve_equilibrium(model, poses.perturbed(joint, angles - poses.q[:, joint])).tcp
        return np.asarray(np.linalg.norm(at - tcp, axis=1))

    grid, gap = np.linspace(-np.pi, np.pi, GRID, endpoint=False, retstep=True)
    best = grid[np.argmin([distance(angle) for angle in grid.tolist()], axis=0)]
    low, high = best - gap, best + gap
    for _ in range(TERNARY_STEPS):
        first, second = low + (high - low) / 3.0, high - (high - low) / 3.0
        below = distance(first) < distance(second)
        low, high = np.where(below, low, first), np.where(below, second, high)
    return np.asarray(0.5 * (low + high))
