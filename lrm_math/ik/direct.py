"""The direct method: angles that the joints must really have, then what to command for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.ik.deployment import Ask, Deployment, Found

BATCHES = (8, 24, 96)
"""How many poses of the library are tried at a time when the closed form's branches lead to nothing."""


@dataclass(frozen=True)
class Direct:
    """Newton's method on the rigid calibrated chain from the closed form's branches; commands follow from loads.

    The closed form is that of an arm that resembles the calibrated one. Goals beyond its reach are pulled inwards for
    the seed; where even that leads to nothing within the limits, the nearest of many poses all over the range are
    tried.
    """

    name: str = "direct"

    def find(self, deployment: Deployment, ask: Ask) -> Found | None:
        """All branches that the seeds lead to; None if no seed leads to the goal."""
        seeds = deployment.likeness.seeds(ask.goal, ask.near)
        found = deployment.solve_seeds(ask, seeds) if len(seeds.q) else None
        if found is not None and deployment.usable(found).any():
            return found
        best = found if found is not None and len(found.q) else None
        order = deployment.library.closest(ask.goal, sum(BATCHES))
        for batch in np.split(order, np.cumsum(BATCHES)[:-1]):
            found = deployment.solve_from(ask, deployment.library.amounts[batch])
            if deployment.usable(found).any():
                return found
            best = found if best is None and len(found.q) else best
        return best
