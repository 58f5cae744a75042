"""The thesis's first method, kept to show how it stalls (Conenna 2024, section 7.2, Figures 7.2 to 7.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.ik.batch_equilibrium import settled
from lrm_math.ik.equivalent_arm import SLACK
from lrm_math.ik.initial_guess import first_guesses, nominal
from lrm_math.ik.solver_context import Ask, Deployment, Found, Stalled
from lrm_math.kinematics.chain import Number

STILL = 1e-6
"""m: the error has settled when it changes by less."""


@dataclass(frozen=True)
class Iterative:
    """Nominal inverse, calibrated forward, aim as far on the other side of the goal as the tool was off it; repeat.

    Each new aim is the goal minus the last error, not the last aim minus the last error. Let the calibrated arm make
    x + d + D (x − goal) of an aim x; then errors follow e' = d − (1 + D) e. The first correction takes most of the
    error d away, but it comes back and swings in to d / (2 + D), about half of it, if it settles at all.

    `enough`: m, an error that ends it. `most`: steps.
    """

    enough: float = 1e-3
    most: int = 100
    name: str = "iterative"

    def find(self, deployment: Deployment, ask: Ask) -> Found | Stalled | None:
        """Where it ended; None if the arm does not even settle at the start."""
        drawn = next(first_guesses(deployment, ask))
        goal = np.array(ask.goal.position)
        q, errors = drawn.q, [0.0][:0]
        near: list[Number] | None = None
        for step in range(1, self.most + 1):
            rest, rows = settled(deployment.model, deployment.poses(ask, q[None]), near, 0.1 * STILL)
            if not len(rows):
                break
            error = rest.true_tcp[0] - goal
            errors.append(float(np.linalg.norm(error)))
            at_rest = step > 2 and max(abs(errors[-1] - before) for before in errors[-3:-1]) < STILL
            if errors[-1] <= self.enough:
                return deployment.standing(ask, q[None], step)
            answer, valid = nominal(deployment, (drawn.position - error)[None], drawn.rotation, q, SLACK)
            if at_rest or not valid[0]:
                break
            near = list(rest.slots)
            for k, turn in zip(deployment.model.chain.joint_slots, (answer[0] - q).tolist(), strict=True):
                near[k] = near[k] + turn
            q = answer[0]
        return Stalled(tuple(q.tolist()), tuple(errors)) if errors else None
