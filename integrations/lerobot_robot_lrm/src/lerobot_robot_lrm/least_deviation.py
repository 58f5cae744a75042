"""Joint angles at which a tool stands near a goal, as a continuous function of the wished angles they start from.

Regularised Gauss–Newton: each step solves anew for the whole way from the wish, so that the wish is its only start. It
responds to a singular value σ of the Jacobian (m/rad) by σ⁵/(σ⁶ + μ⁶) in place of 1/σ, Tikhonov's filter (1963) two
orders sharper: J^T A² (A³ + μ⁶)⁻¹, A = J J^T. What moves the tool much faster than μ is corrected as by Newton's
method; what hardly moves it (the first joint, near its axis; a stretched arm) turns by less than miss/μ, and the miss
remains.

Near its axis the angle that would still reach the goal changes by about reach · miss/σ² for each radian of the wish.
Therefore μ² = reach · miss/`GAIN`: this ratio stays near `GAIN`, whatever the model. A fixed number of steps, each with
a projection onto a box about the wish, is Lipschitz as each of them is: no branch, no line search and no test of
convergence chooses between two answers. Orientation takes second place (Chiaverini 1997): it uses what the position
leaves free, with a smaller gain.

Where a command ends at a limit, the other joints make up for the tool's motion that this takes away (redistribution, as
in saturated null-space control: Flacco, De Luca & Khatib 2012). A joint loses its part in that by and by, within
`FADES` beyond its limit, so that the answer stays continuous.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.goal import CHAR_LENGTH
from lrm_math.ik.kernel.kernel_model import KernelModel

GAIN, ORIENTATION_GAIN = 12.0, 1.0
"""Radians by which a correction may change, near a singular pose, for one radian of the wish; see above."""
FARTHEST = 0.15
"""rad: no joint is turned by more for the sake of the tool."""
STEPS, RETURNS = 3, 3
"""Steps to the goal, and steps back within the limits."""
FADES = math.radians(0.5)
"""rad that a command must lie beyond its limit until the joint takes no part in making up for it."""
UNLIMITED = np.array([[-np.inf], [np.inf]])
"""(2, 1), rad: of joint angles, not of commands."""
NUDGE = 1e-7
"""rad, of the difference quotients."""
ROUND_OFF = 1e-5
"""m/rad: what moves the tool no faster is not used, however small the miss."""
POSITION, FULL_POSE = 3, 6
"""Rows of a position; joints from which an arm can take any orientation."""
HeldState: TypeAlias = tuple[Array, Array, Array]
"""Slot amounts (V,) in equilibrium, their loads (V,), and the command (n,) that holds them."""


def nearest_state(
    arm: KernelModel, hold: Callable[[Array], HeldState], slots: Array, goal: Array, limits: Array = UNLIMITED
) -> HeldState:
    """The state whose joints bring the tool near to a frame (4, 4), m, from amounts (V,) with the wished joint angles.

    None of these is left by more than `FARTHEST`. Arms of fewer than six joints are brought to the position alone: what
    orientation they can have is that of the wished angles.

    Args:
        hold: the state of amounts (V,) whose joints stay.
        limits: (2, n) or (2, 1), of commands (rad), near which the state ends, not exactly at them.
    """
    joints = arm.moving.joints
    wished, state = slots[joints], hold(slots)
    first, _ = _linearised(arm, state[0], goal)
    floors = [_floor(arm, first[:POSITION], GAIN), _floor(arm, first, ORIENTATION_GAIN)]
    for _ in range(STEPS):
        miss, J = _linearised(arm, state[0], goal)
        turned = _turned(J, J @ (state[0][joints] - wished) - miss, floors)
        moved = state[0].copy()
        moved[joints] = wished + np.clip(turned, -FARTHEST, FARTHEST)
        state = hold(moved)
    return _within(arm, hold, state, wished, limits)


def _within(
    arm: KernelModel, hold: Callable[[Array], HeldState], state: HeldState, wished: Array, limits: Array
) -> HeldState:
    """A state whose commands come back within their limits (2, n), rad, while the other joints make up for it.

    A joint moves the tool by `reach` for each radian at most, so that the others turn by `GAIN` radians for it at most.
    """
    joints, taken = arm.moving.joints, np.zeros_like(wished)
    floor = (arm.memory.reach / GAIN) ** 2
    for _ in range(RETURNS):
        beyond = state[2] - np.clip(state[2], *limits)
        taken = taken + beyond
        if not taken.any():
            break
        free = 1.0 - np.minimum(np.abs(taken) / FADES, 1.0)
        J = _linearised(arm, state[0], np.eye(4))[1][:POSITION]
        made_up = free * (_filtered(J * free, floor) @ (J @ beyond))
        moved = state[0].copy()
        moved[joints] = wished + np.clip(moved[joints] - wished - beyond + made_up, -FARTHEST, FARTHEST)
        state = hold(moved)
    return state


def _floor(arm: KernelModel, miss: Array, gain: float) -> float:
    """μ² (m²/rad²) of what the tool lacks at the wish (M,), m."""
    return ROUND_OFF**2 + float(arm.memory.reach * np.linalg.norm(miss)) / gain


def _turned(J: Array, lack: Array, floors: Sequence[float]) -> Array:
    """(n,), rad, by which the joints make up for what the tool lacks at the wish (M,), m, by a Jacobian (M, n)."""
    back = _filtered(J[:POSITION], floors[0])
    turned = back @ lack[:POSITION]
    if len(lack) == POSITION:
        return np.asarray(turned)
    free = np.eye(J.shape[1]) - back @ J[:POSITION]
    orient = _filtered(J[POSITION:] @ free, floors[1])
    return np.asarray(turned + free @ (orient @ (lack[POSITION:] - J[POSITION:] @ turned)))


def _filtered(J: Array, floor: float) -> Array:
    """(n, M), inverse of a Jacobian (M, n), m/rad, of what moves the tool faster than the root of `floor`, m²/rad²."""
    A = J @ J.T
    return np.asarray(J.T @ np.linalg.solve(A @ A @ A + floor**3 * np.eye(len(A)), A @ A))


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
