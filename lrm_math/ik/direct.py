"""The direct method: angles that the joints must really have, then what to command for them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lrm_math.ik.deployment import Ask, Deployment, Found
from lrm_math.ik.newton import ANY_BRANCH, LAST_RESORT, Aim, beside_folds

TRIES = ((8, ANY_BRANCH), (24, LAST_RESORT), (96, LAST_RESORT))
"""How many poses of the library are tried, and how hard, when what was tried before leads to nothing."""
FOLDS = 3
"""How many candidates that got stuck are helped off the fold that they may stand on."""


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
        best: Found | None = None
        for found in self._attempts(deployment, ask):
            if deployment.usable(found).any():
                return found
            best = found if best is None and len(found.q) else best
        return best

    def _attempts(self, deployment: Deployment, ask: Ask) -> Iterator[Found]:
        seeds = deployment.likeness.seeds(ask.goal, ask.near)
        start = deployment.start_at(ask, seeds)
        if len(start):
            found, reached = deployment.solve_from(ask, start)
            yield found
            start = beside_folds(deployment.compensation, Aim.of(ask.goal), reached, FOLDS)
        if ask.goal.rotation is not None:
            pulled = deployment.start_at(replace(ask, near=None), deployment.likeness.pulled(ask.goal, seeds.numbers))
            if len(pulled):
                found, _ = deployment.solve_from(ask, pulled)
                yield found
        order = deployment.library.closest(ask.goal, sum(count for count, _ in TRIES))
        for count, effort in TRIES:
            batch, order = order[:count], order[count:]
            start = np.concatenate([start, deployment.library.amounts[batch]])
            found, reached = deployment.solve_from(ask, start, effort)
            yield found
            start = beside_folds(deployment.compensation, Aim.of(ask.goal), reached, FOLDS)
