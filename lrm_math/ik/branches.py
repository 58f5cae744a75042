"""Extended search for all branches of a pose, a few milliseconds long."""

from __future__ import annotations

import numpy as np

from lrm_math.ik.direct import Direct
from lrm_math.ik.fold_seeds import fold_seeds
from lrm_math.ik.multi_start import distinct
from lrm_math.ik.null_space_seeds import null_space_seeds
from lrm_math.ik.solver_context import CommandBatch, IkQuery, SolverContext

LIBRARY_SEEDS = 2
"""Number of library seeds besides those of the closed form."""
SAME = 1e-4
"""rad: solutions no further apart are one."""
GENERATIONS = 2
"""Fold seeds from solutions that fold seeds led to: where two folds meet, there are four solutions."""


def every_branch(context: SolverContext, query: IkQuery) -> CommandBatch | None:
    """The branches of the direct method; for a full pose also those from further seeds, and their fold partners."""
    found = Direct().find(context, query)
    if found is None or query.goal.rotation is None or not context.within_limits(found).any():
        return found
    starts = np.concatenate([context.library_seeds.starts(query.goal, LIBRARY_SEEDS), null_space_seeds(context, query)])
    more, _ = context.solve_from(query, starts)
    found = found.joined(more)
    new, known = found, np.empty((0, found.q.shape[1] + starts.shape[1]))
    for _ in range(GENERATIONS):
        rows = np.hstack([new.q, new.reached.amounts])[context.within_limits(new)]
        before, known = len(known), distinct(np.concatenate([known, rows]), SAME)
        q, amounts = np.hsplit(known, [found.q.shape[1]])
        starts = fold_seeds(context, query, q[before:], amounts[before:], q)
        if not len(starts):
            break
        new, _ = context.solve_from(query, starts)
        found = found.joined(new)
    return found
