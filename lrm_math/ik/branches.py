"""As many ways to a pose as can be found in a millisecond or two: a list to choose from."""

from __future__ import annotations

import numpy as np

from lrm_math.chain import Array
from lrm_math.ik.deployment import Ask, Deployment, Found
from lrm_math.ik.direct import Direct
from lrm_math.ik.newton import Aim
from lrm_math.ik.search import distinct

MORE = 4
"""How many of the library's most promising poses are tried besides what the closed form leads to."""
SLOW = 3e-3
"""m/rad: where a motion of the joints moves the tool by less (turns weighed by `newton.LEVER`), a fold is near;
elsewhere other starts lead to both sides of it."""
NUDGE = 0.02
"""rad, a turn that tells how quickly the fold comes nearer."""
FURTHEST = 1.5
"""rad: a twin is not sought further away."""
KNOWN = 0.35
"""A start that is closer to a known solution than this share of its way is taken to lead there."""
BEYOND = 0.2
"""rad: nor is it sought where the start is further than this outside the limits."""
SAME = 1e-4
"""rad: solutions no further apart are one."""
GENERATIONS = 2
"""Twins of twins: where two folds meet, there are four solutions."""


def every_branch(deployment: Deployment, ask: Ask) -> Found | None:
    """What the direct method finds; for a whole pose also what poses of the library lead to, and the twins of all.

    Twins are two ways to a pose that merge at a fold, where axes line up: near it, one tells where the other is.
    """
    found = Direct().find(deployment, ask)
    if found is None or ask.goal.rotation is None or not deployment.usable(found).any():
        return found
    more, _ = deployment.solve_from(ask, deployment.leaps.starts(ask.goal, MORE))
    return _with_twins(deployment, ask, found.joined(more))


def _with_twins(deployment: Deployment, ask: Ask, found: Found) -> Found:
    known = np.empty((0, found.q.shape[1] + found.reached.amounts.shape[1]))
    more = found
    for _ in range(GENERATIONS):
        rows = np.hstack([more.q, more.reached.amounts])[deployment.usable(more)]
        before, known = len(known), distinct(np.concatenate([known, rows]), SAME)
        starts = _beyond_folds(deployment, ask, known[before:], known)
        if not len(starts):
            break
        more, _ = deployment.solve_from(ask, starts)
        found = found.joined(more)
    return found


def _beyond_folds(deployment: Deployment, ask: Ask, rows: Array, known: Array) -> Array:
    """(M, V), amounts of the moving slots where twins may be.

    Along the joint motion that hardly moves the tool, the tool goes forth and comes back. To second order, both ends
    of that way are as far from where it turns: one root of a parabola gives the other.

    Args:
        rows: (K, n + V), commands of solutions, and amounts there. `known`: (L, n + V), those not to be found again.
    """
    linkage, aim = deployment.compensation.linkage, Aim.of(ask.goal)
    n = len(linkage.joints)

    def jacobian(amounts: Array) -> Array:
        placed = linkage.place(amounts)
        return aim.rows_of(linkage.jacobian(placed), placed.tcp)[:, :, linkage.joints]

    J = jacobian(rows[:, n:])
    left, slopes, right = np.linalg.svd(J, full_matrices=False)
    near = slopes[:, -1] < SLOW
    if not near.any():
        return known[:0, n:]
    q, amounts = rows[near, :n], rows[near, n:]
    still = right[near, -1] / np.abs(right[near, -1]).max(axis=1, keepdims=True)

    def slope(J: Array) -> Array:
        return np.asarray(np.einsum("kr,krn,kn->k", left[near, :, -1], J, still))

    nudged = amounts.copy()
    nudged[:, linkage.joints] += NUDGE * still
    bend = (slope(jacobian(nudged)) - slope(J[near])) / NUDGE
    far = -2.0 * slope(J[near]) / np.where(bend == 0.0, np.inf, bend)
    turn = far[:, None] * still
    apart = np.abs((q + turn)[:, None] - known[:, :n]).max(axis=2).min(axis=1)
    worth = (np.abs(far) <= FURTHEST) & (apart > KNOWN * np.abs(far)) & deployment.band.holds(q + turn, BEYOND)
    amounts[:, linkage.joints] += turn
    return np.asarray(amounts[worth])
