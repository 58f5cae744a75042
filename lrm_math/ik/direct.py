"""The direct method: angles that the joints must really have, then what to command for them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lrm_math.ik.folds import beside_folds
from lrm_math.ik.nearest import misses
from lrm_math.ik.newton import ANY_BRANCH, FIRST_BRANCH, LAST_RESORT, STRAYS, Aim
from lrm_math.ik.solver_context import Ask, Deployment, Found

TRIES = ((8, ANY_BRANCH), (24, LAST_RESORT), (96, LAST_RESORT))
"""How many poses of the library are tried, and how hard, when what was tried before leads to nothing."""
HOPEFUL = 0.01
"""m: a goal that the nearest command within the limits misses by more is not tried from the library; nor taken, of
thousands that could be."""
GAPS = {3: 0.04, 5: 0.08}
"""m: positions, and those with an approach, that are further from every pose of the library are first asked whether
they come within reach; few of those that do are as far."""
LEAPS = 12
"""How many of the most promising poses of the library are tried for a whole pose, one after the other."""
FOLDS = 3
"""How many candidates that got stuck are helped off the fold that they may stand on."""


@dataclass(frozen=True)
class Direct:
    """Newton's method on the rigid calibrated chain from the closed form's branches; commands follow from loads.

    The closed form is that of an arm that resembles the calibrated one. Where that leads to nothing within the limits,
    poses all over the range are tried, the most promising first, then goals pulled inwards; at last ever more poses, as
    long as the nearest command within the limits comes close.
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
        library, whole = deployment.library, ask.goal.rotation is not None
        if not library.around.holds(ask.goal.position):
            return
        if not whole and library.gap(ask.goal) > GAPS[ask.goal.constraints] and misses(deployment, ask, HOPEFUL):
            count, effort = TRIES[0]
            yield deployment.solve_from(ask, library.amounts[library.closest(ask.goal, count)], effort)[0]
            return
        seeds = deployment.likeness.seeds(ask.goal, ask.near)
        start = strays = deployment.start_at(ask, seeds)
        if len(start):
            found, reached = deployment.solve_from(ask, start)
            yield found
            strays = reached.amounts[reached.left]
            start = beside_folds(deployment.compensation.linkage, Aim.of(ask.goal), reached, FOLDS)
        if whole:
            found, leapt = deployment.solve_from(ask, deployment.leaps.starts(ask.goal, LEAPS), FIRST_BRANCH)
            yield found
            strays = np.concatenate([strays, leapt.amounts[leapt.left]])
            if len(strays):
                yield deployment.solve_from(ask, strays, STRAYS)[0]
            pulled = deployment.start_at(replace(ask, near=None), deployment.likeness.pulled(ask.goal, seeds.numbers))
            if len(pulled):
                found, _ = deployment.solve_from(ask, pulled)
                yield found
        order = library.closest(ask.goal, sum(count for count, _ in TRIES))
        for count, effort in TRIES:
            batch, order = order[:count], order[count:]
            start = np.concatenate([start, library.amounts[batch]])
            found, reached = deployment.solve_from(ask, start, effort)
            yield found
            if misses(deployment, ask, HOPEFUL):
                return
            start = beside_folds(deployment.compensation.linkage, Aim.of(ask.goal), reached, FOLDS)
