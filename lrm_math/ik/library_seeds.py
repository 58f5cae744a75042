"""Seeds from the pose library, ranked by Newton's first step to the goal: its length and excess beyond limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.library import PoseLibrary
from lrm_math.ik.linkage import Indices, Linkage
from lrm_math.ik.newton import WEIGHTS, JointBounds, Target

CLOSEST = 256
"""Number of the closest poses that are ranked."""
DAMPING = 1e-4
"""m²: keeps steps short where the arm is nearly singular."""
LONGEST = 0.6
"""rad: largest turn of a joint from a pose to its seed."""


@dataclass(frozen=True, eq=False)
class LibrarySeeds:
    """Newton's first step for a full pose, precomputed for every pose of the library.

    `joints`: positions of the joints among the moving slots. `inverse`: (M, n, 6), damped least-squares inverse of the
    Jacobian, rotation weighed by `newton.CHAR_LENGTH` (rad/m).
    """

    library: PoseLibrary
    joints: Indices
    inverse: Array
    bounds: JointBounds

    @classmethod
    def of(cls, library: PoseLibrary, linkage: Linkage, bounds: JointBounds) -> LibrarySeeds:
        """For an arm and its limits."""
        state = linkage.forward(library.amounts)
        J = WEIGHTS * linkage.jacobian(state)[:, :, linkage.joints]
        turned = J.transpose(0, 2, 1)
        normal = turned @ J + DAMPING * np.eye(len(linkage.joints))
        return cls(library, linkage.joints, np.asarray(np.linalg.solve(normal, turned)), bounds)

    def starts(self, goal: Goal, count: int) -> Array:
        """(count, V), slot amounts, the best ranked first."""
        rows = self.library.closest(goal, CLOSEST)
        error = Target.of(goal).error(self.library.tcp[rows])
        step = (self.inverse[rows] @ error[:, :, None])[:, :, 0]
        q = self.library.q[rows] + step
        beyond = np.maximum(np.maximum(self.bounds.lower - q, q - self.bounds.upper), 0.0).max(axis=1)
        length = np.abs(step).max(axis=1)
        best = np.argsort(length + beyond)[:count]
        out = self.library.amounts[rows[best]]
        out[:, self.joints] += step[best] * (LONGEST / np.maximum(length[best], LONGEST))[:, None]
        return np.asarray(out)
