"""As many ways to a pose as can be found in a few milliseconds: a list to choose from."""

from __future__ import annotations

import numpy as np

from lrm_math.ik.direct import Direct
from lrm_math.ik.fold_seeds import twins
from lrm_math.ik.multi_start import distinct
from lrm_math.ik.null_space_seeds import slid_into_limits
from lrm_math.ik.solver_context import Ask, Deployment, Found

LEAPS = 2
"""How many of the library's most promising poses are tried besides what the closed form leads to."""
SAME = 1e-4
"""rad: solutions no further apart are one."""
GENERATIONS = 2
"""Twins of twins: where two folds meet, there are four solutions."""


def every_branch(deployment: Deployment, ask: Ask) -> Found | None:
    """What the direct method finds; for a whole pose also what further starts lead to, and the twins of all."""
    found = Direct().find(deployment, ask)
    if found is None or ask.goal.rotation is None or not deployment.usable(found).any():
        return found
    starts = np.concatenate([deployment.leaps.starts(ask.goal, LEAPS), slid_into_limits(deployment, ask)])
    more, _ = deployment.solve_from(ask, starts)
    found = found.joined(more)
    new, known = found, np.empty((0, found.q.shape[1] + starts.shape[1]))
    for _ in range(GENERATIONS):
        rows = np.hstack([new.q, new.reached.amounts])[deployment.usable(new)]
        before, known = len(known), distinct(np.concatenate([known, rows]), SAME)
        q, amounts = np.hsplit(known, [found.q.shape[1]])
        starts = twins(deployment, ask, q[before:], amounts[before:], q)
        if not len(starts):
            break
        new, _ = deployment.solve_from(ask, starts)
        found = found.joined(new)
    return found
