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
STEPS, ARRIVED = 20, 1e-6
"""Gauss–Newton steps at most; rad."""
SHORT, SHORTER, LONGER = 1e-5, 10.0, 10.0
"""m²/rad², of a step that is shortened first; by how much more, where that is not enough, and less, where it was."""
NUDGE = 1e-7
"""rad, of the difference quotients."""
FULL_POSE = 6
"""Joints from which an arm can take any orientation."""


def nearest_slots(arm: KernelModel, slots: Array, goal: Array) -> Array:
    """(V,), slot amounts whose joints bring the tool nearest to a frame (4, 4), m; other slots stay.

    From amounts (V,) with the wished joint angles, by Gauss–Newton steps; near a singular pose, where one may lead
    away, shortened until the sum of squares falls (Marquardt 1963). Arms of fewer than six joints are brought to the
    position alone: what orientation they can have is that of the wished angles.
    """
    joints, out, shortened = arm.moving.joints, slots.copy(), 0.0
    best, least = out.copy(), np.inf
    for _ in range(STEPS):
        miss, J = _linearised(arm, out, goal)
        away = (out - slots)[joints]
        squares = float(miss @ miss + DAMPING**2 * away @ away)
        if squares < least:
            best, least, shortened = out.copy(), squares, shortened / LONGER
            H, gradient = J.T @ J + DAMPING**2 * np.eye(len(joints)), J.T @ miss + DAMPING**2 * away
        else:
            shortened = max(SHORTER * shortened, SHORT)
        step = np.linalg.solve(H + shortened * np.eye(len(joints)), -gradient)
        out[joints] = best[joints] + step
        if np.abs(step).max() < ARRIVED:
            return out
    return best


def _linearised(arm: KernelModel, slots: Array, goal: Array) -> tuple[Array, Array]:
    """(M,), deviation of the tool from a goal (m), at slot amounts (V,), and its derivative by the joints (M, n)."""
    joints = arm.moving.joints
    states = np.tile(slots, (len(joints) + 1, 1))
    states[np.arange(1, len(joints) + 1), joints] += NUDGE
    tools, _ = arm.forward(states)
    miss = _deviations(tools, goal)
    if len(joints) >= FULL_POSE:
        miss = np.concatenate([miss, _turns(tools, goal)], axis=1)
    return miss[0], (miss[1:] - miss[0]).T / NUDGE


def _deviations(tools: Array, goal: Array) -> Array:
    """(K, 3) position, of frames (K, 4, 4) from a goal (m)."""
    return np.asarray(tools[:, :3, 3] - goal[:3, 3])


def _turns(tools: Array, goal: Array) -> Array:
    """(K, 3), sines of small rotations of frames (K, 4, 4) from a goal, times `CHAR_LENGTH` (m)."""
    left = tools[:, :3, :3] @ goal[:3, :3].T
    return CHAR_LENGTH * 0.5 * (left[:, [2, 0, 1], [1, 2, 0]] - left[:, [1, 2, 0], [2, 0, 1]])
