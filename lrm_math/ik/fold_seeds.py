"""Twins: near a fold, where two ways to a pose meet, one of them tells where the other is."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.folds import Slowest
from lrm_math.ik.newton import Aim
from lrm_math.ik.solver_context import Ask, Deployment

SLOW = 5e-3
"""m/rad: a fold is near where the tool goes slower than this with some motion of the joints."""
NUDGE = 0.02
"""rad, a turn that tells how the slope changes."""
FURTHEST = 1.5
"""rad: a twin is not sought further away."""
KNOWN = 0.35
"""A start that is closer to a known solution than this share of its way is taken to lead there."""
BEYOND = 0.2
"""rad: nor is it sought where the start is further than this outside the limits."""


def twins(deployment: Deployment, ask: Ask, q: Array, amounts: Array, known: Array) -> Array:
    """(M, V), amounts of the moving slots where twins of solutions may be.

    With t of the motion that hardly moves the tool (rad), the tool goes slope·t + bend·t²/2 away and comes back: to
    second order the other solution is at t = -2 slope / bend.

    Args:
        q: (K, n), commands of the solutions (rad). `amounts`: (K, V) there. `known`: (L, n), commands not to be found
            again.
    """
    linkage, aim = deployment.compensation.linkage, Aim.of(ask.goal)
    slowest = Slowest.of(linkage, aim, amounts)
    near = slowest.slope < SLOW
    q, amounts, slowest = q[near], amounts[near], slowest.take(near)
    if not len(q):
        return amounts
    nudged = amounts.copy()
    nudged[:, linkage.joints] += NUDGE * slowest.along
    bend = (slowest.slope_at(linkage, aim, nudged) - slowest.slope) / NUDGE
    far = -2.0 * slowest.slope / np.where(bend == 0.0, np.inf, bend)
    turn = far[:, None] * slowest.along
    apart = np.abs((q + turn)[:, None] - known).max(axis=2).min(axis=1)
    worth = (np.abs(far) <= FURTHEST) & (apart > KNOWN * np.abs(far)) & deployment.band.holds(q + turn, BEYOND)
    starts = amounts.copy()
    starts[:, linkage.joints] += turn
    return np.asarray(starts[worth])
