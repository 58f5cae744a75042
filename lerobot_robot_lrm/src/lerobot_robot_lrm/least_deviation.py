"""Joint angles at which a tool stands as near as it can to a goal, without leaving the neighbourhood of wished angles.

Least squares of the tool's deviation and, weighted little, of the joints' own (Tikhonov 1963; Wampler 1986): where the
goal can be met it is met, and at singular poses, or beyond the reach, the answer stays a smooth function of the wish.
"""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.goal import CHAR_LENGTH
from lrm_math.ik.kernel.kernel_model import KernelModel

DAMPING = 2e-3
"""m/rad: a joint's deviation of 1 rad weighs as much as one of the tool by so much."""
STEPS, ARRIVED = 6, 1e-6
"""Gauss–Newton steps at most; rad."""
NUDGE = 1e-7
"""rad, of the difference quotients."""
FULL_POSE = 6
"""Joints from which an arm can take any orientation."""


def nearest_slots(arm: KernelModel, slots: Array, goal: Array) -> Array:
    """(V,), slot amounts whose joints bring the tool nearest to a frame (4, 4), m; other slots stay.

    From amounts (V,) with the wished joint angles. Arms of fewer than six joints are brought to the position alone:
    what orientation they can have is that of the wished angles.
    """
    joints, out = arm.moving.joints, slots.copy()
    n, nudged = len(joints), np.arange(1, len(joints) + 1)
    for _ in range(STEPS):
        states = np.tile(out, (n + 1, 1))
        states[nudged, joints] += NUDGE
        tools, _ = arm.forward(states)
        miss = _deviations(tools, goal)
        if n >= FULL_POSE:
            miss = np.concatenate([miss, _turns(tools, goal)], axis=1)
        J = (miss[1:] - miss[0]).T / NUDGE
        pull = DAMPING**2 * (out - slots)[joints]
        step = np.linalg.solve(J.T @ J + DAMPING**2 * np.eye(n), -J.T @ miss[0] - pull)
        out[joints] += step
        if np.abs(step).max() < ARRIVED:
            break
    return out


def _deviations(tools: Array, goal: Array) -> Array:
    """(K, 3) position, of frames (K, 4, 4) from a goal (m)."""
    return np.asarray(tools[:, :3, 3] - goal[:3, 3])


def _turns(tools: Array, goal: Array) -> Array:
    """(K, 3), sines of small rotations of frames (K, 4, 4) from a goal, times `CHAR_LENGTH` (m)."""
    left = tools[:, :3, :3] @ goal[:3, :3].T
    return CHAR_LENGTH * 0.5 * (left[:, [2, 0, 1], [1, 2, 0]] - left[:, [1, 2, 0], [2, 0, 1]])
