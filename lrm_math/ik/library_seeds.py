"""The most promising starts among the poses of the library: those from which one step leads to a goal within limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.goal import Goal
from lrm_math.ik.library import Library
from lrm_math.ik.linkage import Indices, Linkage
from lrm_math.ik.newton import WEIGHTS, Aim, Band

CLOSEST = 256
"""How many of the closest poses are judged by their step."""
DAMPING = 1e-4
"""m²: keeps steps short where the arm is nearly singular."""
LONGEST = 0.6
"""rad: a start is no further than this from its pose, joint by joint."""


@dataclass(frozen=True, eq=False)
class Leaps:
    """Newton's first step for a whole pose, ready for every pose of the library.

    `joints`: where the joints stand among the moving slots. `inverse`: (M, n, 6), from what is left of the goal, turns
    weighed by `newton.LEVER`, to turns of the joints (rad/m).
    """

    library: Library
    joints: Indices
    inverse: Array
    band: Band

    @classmethod
    def of(cls, library: Library, linkage: Linkage, band: Band) -> Leaps:
        """For an arm and its limits."""
        placed = linkage.place(library.amounts)
        J = WEIGHTS * linkage.jacobian(placed)[:, :, linkage.joints]
        turned = J.transpose(0, 2, 1)
        normal = turned @ J + DAMPING * np.eye(len(linkage.joints))
        return cls(library, linkage.joints, np.asarray(np.linalg.solve(normal, turned)), band)

    def starts(self, goal: Goal, count: int) -> Array:
        """(count, V), amounts of the moving slots, the most promising first."""
        rows = self.library.closest(goal, CLOSEST)
        error = Aim.of(goal).error(self.library.tcp[rows])
        step = (self.inverse[rows] @ error[:, :, None])[:, :, 0]
        q = self.library.q[rows] + step
        beyond = np.maximum(np.maximum(self.band.lower - q, q - self.band.upper), 0.0).max(axis=1)
        length = np.abs(step).max(axis=1)
        best = np.argsort(length + beyond)[:count]
        out = self.library.amounts[rows[best]]
        out[:, self.joints] += step[best] * (LONGEST / np.maximum(length[best], LONGEST))[:, None]
        return np.asarray(out)
