"""The direct method: solve for the true joint angles, then for the commands that produce them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lrm_math.ik.nearest import error_exceeds
from lrm_math.ik.newton import ANY_BRANCH, FIRST_BRANCH, IGNORE_LIMITS, PATIENT, Target
from lrm_math.ik.singularities import seeds_beside_folds
from lrm_math.ik.solver_context import CommandBatch, IkQuery, SolverContext

ATTEMPTS = ((8, ANY_BRANCH), (24, PATIENT), (96, PATIENT))
"""Library seeds and stopping rule of each attempt, when all before failed."""
REACHABLE = 0.01
"""m: a goal that the nearest command within the limits misses by more is given up."""
GAPS = {3: 0.04, 5: 0.08}
"""m: positions and approach goals further than this from every pose of the library are checked for reach first."""
LIBRARY_SEEDS = 12
"""Number of library seeds for a full pose, one after the other."""
FOLDS = 3
"""Number of stuck candidates that are restarted beside the fold that they may be on."""


@dataclass(frozen=True)
class Direct:
    """Newton's method on the rigid calibrated chain; commands follow from the loads.

    Seeds are the branches of the equivalent arm's closed form. Where these lead to nothing within the limits, library
    seeds and goals retracted inwards follow; at last ever more library poses, as long as the nearest command within
    the limits comes close.
    """

    name: str = "direct"

    def find(self, context: SolverContext, query: IkQuery) -> CommandBatch | None:
        """All branches that the seeds lead to; None if no seed leads to the goal."""
        best: CommandBatch | None = None
        for found in self._attempts(context, query):
            if context.within_limits(found).any():
                return found
            best = found if best is None and len(found.q) else best
        return best

    def _attempts(self, context: SolverContext, query: IkQuery) -> Iterator[CommandBatch]:
        library, full_pose = context.library, query.goal.rotation is not None
        if not library.reach_ball.contains(query.goal.position):
            return
        far = not full_pose and library.gap(query.goal) > GAPS[query.goal.constraints]
        if far and error_exceeds(context, query, REACHABLE):
            count, stopping = ATTEMPTS[0]
            yield context.solve_from(query, library.amounts[library.closest(query.goal, count)], stopping)[0]
            return
        seeds = context.equivalent_arm.seeds(query.goal, query.near)
        start = abandoned = context.start_amounts(query, seeds)
        if len(start):
            found, reached = context.solve_from(query, start)
            yield found
            abandoned = reached.amounts[reached.abandoned]
            start = seeds_beside_folds(context.linkage, Target.of(query.goal), reached, FOLDS)
        if full_pose:
            library_starts = context.library_seeds.starts(query.goal, LIBRARY_SEEDS)
            found, ended = context.solve_from(query, library_starts, FIRST_BRANCH)
            yield found
            abandoned = np.concatenate([abandoned, ended.amounts[ended.abandoned]])
            if len(abandoned):
                yield context.solve_from(query, abandoned, IGNORE_LIMITS)[0]
            retracted = context.amounts_at(context.equivalent_arm.retracted(query.goal, seeds.numbers).q)
            if len(retracted):
                yield context.solve_from(query, retracted)[0]
        order = library.closest(query.goal, sum(count for count, _ in ATTEMPTS))
        for count, stopping in ATTEMPTS:
            batch, order = order[:count], order[count:]
            start = np.concatenate([start, library.amounts[batch]])
            found, reached = context.solve_from(query, start, stopping)
            yield found
            if error_exceeds(context, query, REACHABLE):
                return
            start = seeds_beside_folds(context.linkage, Target.of(query.goal), reached, FOLDS)
