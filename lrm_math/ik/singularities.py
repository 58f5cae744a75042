"""Near-singular configurations and folds, where two solutions of the inverse merge (Borrel & Liégeois 1986).

There some motion of the joints hardly moves the tool: the right singular vector of the Jacobian that belongs to its
smallest singular value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.linkage import Linkage
from lrm_math.ik.newton import NewtonBatch, Target

STEPS_ASIDE = (0.03, 0.1)
"""rad: distances from a fold at which to restart."""


@dataclass(frozen=True, eq=False)
class SingularDirection:
    """The joint motion that moves the tool least, at K states.

    `slope`: (K,), speed of the tool: m/rad, rotation weighed by `newton.CHAR_LENGTH`; but for the scale of
    `joint_motion` the smallest singular value. `joint_motion`: (K, n), scaled to a largest element of 1. `tool_motion`:
    (K, rows), direction of the tool's motion, a unit vector.
    """

    slope: Array
    joint_motion: Array
    tool_motion: Array

    @classmethod
    def of(cls, linkage: Linkage, target: Target, amounts: Array) -> SingularDirection:
        """At slot amounts (K, V), rad or m."""
        tool_motion, slopes, joint_motion = np.linalg.svd(
            _joint_jacobian(linkage, target, amounts), full_matrices=False
        )
        largest = np.abs(joint_motion[:, -1]).max(axis=1, keepdims=True)
        return cls(slopes[:, -1] / largest[:, 0], joint_motion[:, -1] / largest, tool_motion[:, :, -1])

    def take(self, rows: NDArray[np.bool_]) -> SingularDirection:
        """Selected states."""
        return SingularDirection(self.slope[rows], self.joint_motion[rows], self.tool_motion[rows])

    def slope_at(self, linkage: Linkage, target: Target, amounts: Array) -> Array:
        """(K,), speed along the same tool direction by the same joint motion at slot amounts (K, V): m/rad."""
        return np.asarray(
            np.einsum("kr,krn,kn->k", self.tool_motion, _joint_jacobian(linkage, target, amounts), self.joint_motion)
        )


def seeds_beside_folds(linkage: Linkage, target: Target, reached: NewtonBatch, count: int) -> Array:
    """(M, V), starts on both sides of the fold where the `count` best unconverged candidates are stuck.

    Where two solutions merge, a joint motion leaves the tool where it is, and descent may end on the ridge between the
    two: the direction to go on is that motion, either sign.
    """
    best = np.flatnonzero(~reached.converged)[np.argsort(reached.residual[~reached.converged])][:count]
    amounts = reached.amounts[best]
    still = np.linalg.svd(_joint_jacobian(linkage, target, amounts))[2][:, -1]
    out = np.concatenate([amounts] * (2 * len(STEPS_ASIDE)))
    out[:, linkage.joints] += np.concatenate([sign * size * still for size in STEPS_ASIDE for sign in (1.0, -1.0)])
    return out


def _joint_jacobian(linkage: Linkage, target: Target, amounts: Array) -> Array:
    """(K, rows, n), Jacobian of the joints."""
    state = linkage.forward(amounts)
    return target.rows_of(linkage.jacobian(state), state.tcp)[:, :, linkage.joints]
