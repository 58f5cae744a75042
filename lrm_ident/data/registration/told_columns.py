"""One column of measurements as all the others tell it, where what was read there may be another quantity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_ident.data.registration.coarse_fit import coarse_fit
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of

TRIED, HALVINGS, FITS = 48, 25, 2


def told_angles(arm: Arm, poses: Poses, tcp: Array, joint: int) -> Array:
    """(N,), rad, angles of a joint (from 0) for which the arm comes nearest to positions (N, 3), m, all others as read.

    First of the arm as drawn, then of its dimensions that these angles lead to.
    """
    first = _nearest(model_of(arm, ()), poses, tcp, joint)
    fitted = coarse_fit(arm, _with_angles(poses, joint, first), tcp)
    return _nearest(fitted.equilibrium.model, poses, tcp, joint)


def told_coordinate(arm: Arm, poses: Poses, tcp: Array, axis: int) -> Array:
    """(N,), m, one coordinate of positions (N, 3) as the angles and the other two coordinates tell it."""
    tcp = tcp.copy()
    tcp[:, axis] = solve_equilibrium(model_of(arm, ()), poses).tcp[:, axis]
    for _ in range(FITS):
        tcp[:, axis] = coarse_fit(arm, poses, tcp).equilibrium.tcp[:, axis]
    return np.asarray(tcp[:, axis])


def _nearest(model: Model, poses: Poses, tcp: Array, joint: int) -> Array:
    """(N,), the nearest of `TRIED` angles in a full turn, then by ternary search between its neighbours."""

    def missed(angles: Array) -> Array:
        there = solve_equilibrium(model, _with_angles(poses, joint, angles)).tcp
        return np.asarray(np.linalg.norm(there - tcp, axis=1))

    tried, gap = np.linspace(-np.pi, np.pi, TRIED, endpoint=False, retstep=True)
    best = tried[np.argmin([missed(np.full(len(poses), angle)) for angle in tried], axis=0)]
    low, high = best - gap, best + gap
    for _ in range(HALVINGS):
        first, second = low + (high - low) / 3.0, high - (high - low) / 3.0
        below = missed(first) < missed(second)
        low, high = np.where(below, low, first), np.where(below, second, high)
    return np.asarray(0.5 * (low + high))


def _with_angles(poses: Poses, joint: int, angles: Array) -> Poses:
    q = poses.q.copy()
    q[:, joint] = angles
    return replace(poses, q=q)
