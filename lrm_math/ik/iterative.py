"""The thesis's first method, kept to show how it stalls (Conenna 2024, section 7.2, Figures 7.2 to 7.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.ik.answer import NotConverged
from lrm_math.ik.branch import IkSolutions
from lrm_math.ik.calibrated_arm import CalibratedArm, initial_guesses
from lrm_math.ik.goal import IkQuery, pose

STILL = 1e-6
"""m: the error has settled when it changes by less."""


@dataclass(frozen=True)
class Iterative:
    """Nominal inverse, calibrated forward, then the goal mirrored by the error; repeated.

    Each new target is the goal minus the last error, not the last target minus the last error. Let the calibrated arm
    map a target x to x + d + D (x − goal); then errors follow e' = d − (1 + D) e. The first correction removes most of
    the error d, but it returns and settles at d / (2 + D), about half of it, if it settles at all.

    `enough`: m, an error that ends it. `most`: steps.
    """

    enough: float = 1e-3
    most: int = 100
    name: str = "iterative"

    def find(self, arm: CalibratedArm, query: IkQuery) -> IkSolutions | NotConverged | None:
        """The last iterate; None if the arm does not settle at the start."""
        q, errors = next(initial_guesses(arm, query)), list[float]()
        drawn, goal = arm.nominal_tool(q), np.array(query.goal.position)
        start = arm.unloaded_slots(q[None])
        for step in range(1, self.most + 1):
            settled = arm.equilibria(query.payload, q[None], start=start, tolerance=0.1 * STILL)
            if not len(settled.rows):
                break
            error = settled.tcp[0, 9:] - goal
            errors.append(float(np.linalg.norm(error)))
            still = step > 2 and max(abs(errors[-1] - before) for before in errors[-3:-1]) < STILL
            if errors[-1] <= self.enough:
                return IkSolutions((arm.branch(q, settled.slots[0], (0,) * len(q)),), step)
            branches = arm.nominal_solver.branches(pose(drawn[:3, 3] - error, drawn[:3, :3]), q.tolist())
            if still or not branches:
                break
            answer = np.array(branches[0].q)
            start = settled.slots + arm.unloaded_slots(answer[None]) - arm.unloaded_slots(q[None])
            q = answer
        if not errors:
            return None
        return NotConverged(goal=query.goal, method=self.name, last=tuple(q.tolist()), errors=tuple(errors))
