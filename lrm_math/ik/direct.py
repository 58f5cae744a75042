"""The direct method: solve for the true joint angles, then for the commands that produce them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_math.errors import LrmError
from lrm_math.ik.nearest import error_of, nearest
from lrm_math.ik.solutions import IkQuery, IkSolution, IkSolutions
from lrm_math.ik.calibrated_arm import CalibratedArm

REACHED = 0.01
"""m: a goal that the nearest command misses by less is tried once more from there."""


@dataclass(frozen=True)
class Direct:
    """Newton's method on the deflected arm; commands follow from its loads.

    Seeds are the branches of an equivalent arm's closed form, null-space and fold seeds, and poses of the library (see
    section 9 of `kernel/ik_kernel.c`). Where they lead to nothing within the limits, the nearest reachable goal is
    sought, and if it is the goal itself, Newton's method started there.
    """

    name: str = "direct"

    def find(self, context: CalibratedArm, query: IkQuery) -> IkSolutions | None:
        """All branches that the seeds lead to, or commands nearest to `near`; None if no seed leads to the goal."""
        if not context.library.reach_ball.contains(query.goal.position):
            return None
        found = context.branches(query)
        if not found.within:
            found = replace(found, commands=(*_from_the_nearest(context, query, found), *found.commands))
        return found if found.commands else None


def _from_the_nearest(context: CalibratedArm, query: IkQuery, found: IkSolutions) -> tuple[IkSolution, ...]:
    try:
        closest = nearest(context, query, tuple(command.q for command in found.beyond))
    except LrmError:
        return ()
    if error_of(closest) > REACHED:
        return ()
    rest = context.equilibria(query, np.array([closest.q]))
    return tuple(c for slots in rest.slots for c in context.at_goal(query, slots))
