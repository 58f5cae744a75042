"""Seeds across a fold, where two solutions of the inverse merge: from one of them to the other."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.newton import Target
from lrm_math.ik.singularities import SingularDirection
from lrm_math.ik.solver_context import IkQuery, SolverContext

SLOW = 5e-3
"""m/rad: a fold is near where the tool moves slower than this with some joint motion."""
NUDGE = 0.02
"""rad, finite-difference step of the second derivative."""
FURTHEST = 1.5
"""rad: a partner is not sought further away."""
KNOWN = 0.35
"""A seed closer to a known solution than this share of its distance is taken to lead there."""
BEYOND = 0.2
"""rad: nor is it sought further than this outside the limits."""


def fold_seeds(context: SolverContext, query: IkQuery, q: Array, amounts: Array, known: Array) -> Array:
    """(M, V), slot amounts where fold partners of solutions may be.

    Along the singular direction by t (rad) the tool moves slope·t + bend·t²/2: to second order the other solution is
    at t = -2 slope / bend.

    `q`: (K, n), commands of the solutions (rad). `amounts`: (K, V) there. `known`: (L, n), commands found already.
    """
    linkage, target = context.linkage, Target.of(query.goal)
    singular = SingularDirection.of(linkage, target, amounts)
    near = singular.slope < SLOW
    q, amounts, singular = q[near], amounts[near], singular.take(near)
    if not len(q):
        return amounts
    nudged = amounts.copy()
    nudged[:, linkage.joints] += NUDGE * singular.joint_motion
    bend = (singular.slope_at(linkage, target, nudged) - singular.slope) / NUDGE
    far = -2.0 * singular.slope / np.where(bend == 0.0, np.inf, bend)
    turn = far[:, None] * singular.joint_motion
    apart = np.abs((q + turn)[:, None] - known).max(axis=2).min(axis=1)
    useful = (np.abs(far) <= FURTHEST) & (apart > KNOWN * np.abs(far)) & context.bounds.contains(q + turn, BEYOND)
    starts = amounts.copy()
    starts[:, linkage.joints] += turn
    return np.asarray(starts[useful])
