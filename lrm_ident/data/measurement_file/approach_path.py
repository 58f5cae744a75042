"""The path of a campaign that comes to every pose from beside it, and what friction remembers of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.motion import TRAVELS_DEG, Motion

STILL = np.radians(0.1)
"""rad: a joint that is sent no farther stays: a step of an encoder of 12 bits is 0.088°."""


def states_from_beside(q: Array, sides: Array, arm: Arm, distance: float, begins: NDArray[np.bool_]) -> Array:
    """(N, n, K), friction states as `Motion` has them, of an arm that is sent straight to beside each pose and
    from there to it; each joint by `distance` (rad), from the side of its last move, as far as its limits let.

    Args:
        q: (N, n), commanded angles in the measured order (rad).
        sides: (N, n), sign of each joint's last move: they tell from which side a pose was come to.
        begins: (N,), whether it is not known where the arm stood before. There, and where neither such a way nor a
            straight one explains the signs, friction has turned over with the last move.
    """
    states = np.repeat(sides[:, :, None], len(TRAVELS_DEG), axis=2)
    for row in range(1, len(q)):
        for beside in () if begins[row] else _besides(q[row], sides[row], arm, distance):
            then = Motion(q[row - 1], sides[row - 1], states[row - 1]).to(beside, STILL).to(q[row], STILL)
            if np.array_equal(then.side, sides[row]):
                states[row] = then.friction
                break
    return states


def _besides(q: Array, sides: Array, arm: Arm, distance: float) -> tuple[Array, ...]:
    """(n,) each, where the arm may have been sent before a pose (n,): beside it by its sides (n,), nowhere else."""
    low, high = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    return np.clip(q - sides * distance, low, high), q
