"""Search for the pose in which the vehicle is furthest from tipping over, by random poses that shrink about the best.

Adaptive random search (Masri, Bekey & Safford 1980), over poses within the limits and clear of everything.
"""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.collision.straight_move import RESOLUTION
from lrm_math.ik.calibrated_arm import CancellationCheck
from lrmd.safety.collision_guard import CollisionGuard
from lrmd.safety.stability import Stability

FIRST, ROUNDS, POSES, SHRINK = 300, 14, 40, 0.75
"""Poses of the first round; further rounds, poses in each, and how much nearer they are to the best each time."""
MOST_GOALS = 4
"""Best poses that are given."""
LEAST_GAIN = 1e-3
"""rad: less is no reason to move."""


def steadier_poses(
    stability: Stability, guard: CollisionGuard, start: Array, payload: float, seed: int, check: CancellationCheck
) -> Array:
    """(K, n), rad, clear poses with a larger tip-over angle than the start (n,), the largest first; none: K = 0.

    `check` is called before every round; what it raises ends the search.
    """
    rng, (low, high) = np.random.default_rng(seed), guard.scene.limits
    best = np.empty((0, len(start)))
    angles, here = np.empty(0), float(stability.angles(start[None], payload)[0])
    for round_ in range(ROUNDS + 1):
        check()
        if round_ == 0 or not len(best):
            poses = rng.uniform(low, high, (FIRST, len(start)))
        else:
            about = best[rng.integers(min(2, len(best)), size=POSES)]
            poses = np.clip(about + SHRINK**round_ * rng.normal(0.0, 0.5, about.shape) * (high - low), low, high)
        poses_found = stability.angles(poses, payload)
        least = angles[-1] if len(best) == MOST_GOALS else here + LEAST_GAIN
        worth = np.flatnonzero(poses_found > least)
        if not len(worth):
            continue
        clear = worth[guard.separation(poses[worth], payload) >= guard.scene.margin + RESOLUTION]
        best, angles = np.concatenate([best, poses[clear]]), np.concatenate([angles, poses_found[clear]])
        order = np.argsort(-angles)[:MOST_GOALS]
        best, angles = best[order], angles[order]
    return best
