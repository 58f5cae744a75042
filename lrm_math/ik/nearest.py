"""The command within the limits that comes nearest to a goal which cannot be taken."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.answer import Nearest
from lrm_math.ik.batch_equilibrium import settled
from lrm_math.ik.descent import Bent, descend
from lrm_math.ik.goal import Goal
from lrm_math.ik.library import COARSE
from lrm_math.ik.linkage import Indices
from lrm_math.ik.newton import LEVER
from lrm_math.ik.pose_error import farness
from lrm_math.ik.solver_context import Ask, Deployment
from lrm_math.kinematics.chain import Number
from lrm_math.model.equilibrium import Equilibrium

STARTS, ROUGH = 16, 8
"""Poses of the library that are started from, and steps from each until only the best go on."""
KEPT, APART = 3, 0.1
"""How many go on, and how far from each other at least (rad)."""
ROUNDS, FINE = 6, 8
"""How often it is reckoned anew how far the arm gives way, and steps from one time to the next."""
HOPELESS = 1.1
"""Times the least error: whoever is further off than that, and by more than `ROUGHNESS`, goes on no further."""
ROUGHNESS = 3e-3
"""m: what a few steps may do to how far the arm gives way."""
ENOUGH, FAR = 1e-3, 0.1
"""A round that lessens an error (m), or as much of it as is not `FAR`, by no larger a share is the last."""


def nearest(deployment: Deployment, ask: Ask, starts: Array) -> Nearest:
    """Least squares of distance (m) and turn (rad, times `newton.LEVER`) over the commands within the limits.

    From the closest poses of the library and from `starts` (K, n), commands (rad): Newton's method, commands kept
    within the limits. The arm gives way as it does at the start until the best few are known, for which that is
    reckoned anew every few steps.

    Raises:
        LrmError: the arm comes to rest nowhere near, so there is nothing to propose.
    """
    found = nearest_of_library(deployment, ask)
    if len(starts):
        inside = np.clip(starts, deployment.band.lower, deployment.band.upper)
        rest, _ = settled(deployment.model, deployment.poses(ask, inside), None, COARSE)
        other = _from(deployment, ask, rest.poses.q, _amounts(deployment, rest)) if len(rest.poses) else None
        found = min((some for some in (found, other) if some is not None), key=_error, default=None)
    if found is None:
        raise LrmError("the arm comes to rest in no pose near this goal; its compliances may be wrong")
    return found


@lru_cache(maxsize=2)
def nearest_of_library(deployment: Deployment, ask: Ask) -> Nearest | None:
    """`nearest` without other starts; None where the arm comes to no rest.

    Kept, since a method that gives a goal up asks for it, and the answer tells it.
    """
    library = deployment.library
    rows = library.closest(ask.goal, STARTS)
    return _from(deployment, ask, library.q[rows], library.amounts[rows])


def misses(deployment: Deployment, ask: Ask, by: float) -> bool:
    """Whether the nearest command leaves more than a distance (m) of a goal, turns weighed by `newton.LEVER`."""
    found = nearest_of_library(deployment, ask)
    return found is None or _error(found) > by


def _error(found: Nearest) -> float:
    """m, turns included."""
    return math.hypot(found.distance, LEVER * found.angle)


def _from(deployment: Deployment, ask: Ask, q: Array, amounts: Array) -> Nearest | None:
    """The nearest from commands (K, n) and amounts of the moving slots there (K, V); None if none comes to rest."""
    rigid = np.zeros((len(q), amounts.shape[1], q.shape[1]))
    rigid[:, deployment.compensation.linkage.joints, np.arange(q.shape[1])] = 1.0
    q, error = descend(deployment, ask.goal, Bent(q, amounts, rigid), ROUGH)
    order = _apart(q, np.argsort(error))
    for rows in (order[:KEPT], order[KEPT:]):
        best = _finely(deployment, ask, q[rows]) if len(rows) else None
        if best is not None:
            return _value(deployment, ask.goal, best)
    return None


def _apart(q: Array, order: Indices) -> Indices:
    """Those rows of (K, n), in some order, that are further than `APART` from all before them."""
    kept: list[int] = []
    for row in order.tolist():
        if all(np.abs(q[row] - q[other]).max() > APART for other in kept):
            kept.append(row)
    return np.array(kept, dtype=np.int64)


def _finely(deployment: Deployment, ask: Ask, q: Array) -> Equilibrium | None:
    """The arm at rest at a least error, from the best of commands (K, n); None if it comes to rest at none of them."""
    start: list[Number] | None = None
    best, least = None, math.inf
    before = np.full(len(q), np.inf)
    for _ in range(ROUNDS):
        rest, rows = settled(deployment.model, deployment.poses(ask, q), start, COARSE)
        if not len(rows):
            break
        bent = _bent(deployment, rest)
        error = np.sqrt(farness(deployment.compensation.linkage.place(bent.amounts).tcp, ask.goal).square)
        if error.min() < least:
            least, best = float(error.min()), rest.one(int(error.argmin()))
        going = (error <= HOPELESS * least + ROUGHNESS) & (
            before[rows] - error >= ENOUGH * np.minimum(error, FAR) + COARSE
        )
        if not going.any():
            break
        bent, before = bent.take(going), error[going]
        q, _ = descend(deployment, ask.goal, bent, FINE)
        start = _near(deployment, bent.at(q))
    if best is None:
        return None
    last, rows = settled(deployment.model, best.poses)
    return last if len(rows) else None


def _bent(deployment: Deployment, rest: Equilibrium) -> Bent:
    """Poses at rest, and how the moving slots follow their commands, by the linear answer of the loads."""
    compensation, linkage = deployment.compensation, deployment.compensation.linkage
    amounts = _amounts(deployment, rest)
    placed, burden = linkage.place(amounts), compensation.burden(float(rest.poses.payload[0]))
    loads = linkage.loads(placed, burden)
    count, slots = amounts.shape
    springs = np.repeat(compensation.compliances[None], count, axis=0)
    springs[:, linkage.others] = compensation.springs(rest.poses, loads.tau)
    gives = springs @ linkage.slopes(placed, burden, loads).transpose(2, 0, 1)
    by_joint = np.eye(slots)[:, linkage.joints]
    follow = np.linalg.solve(np.eye(slots) - gives, np.tile(by_joint, (count, 1, 1)))
    return Bent(rest.poses.q, amounts, np.asarray(follow))


def _amounts(deployment: Deployment, rest: Equilibrium) -> Array:
    """(K, V), what the moving slots have at rest (rad, m)."""
    slots = deployment.compensation.linkage.slots
    return np.array([np.broadcast_to(rest.slots[k], len(rest.poses)) for k in slots]).T


def _near(deployment: Deployment, amounts: Array) -> list[Number]:
    """Amounts of all slots of the chain, from those of the moving ones (K, V)."""
    out: list[Number] = list(deployment.model.wiring.steady)
    single = len(amounts) == 1
    for k, amount in zip(deployment.compensation.linkage.slots.tolist(), amounts.T, strict=True):
        out[k] = float(amount[0]) if single else amount
    return out


def _value(deployment: Deployment, goal: Goal, rest: Equilibrium) -> Nearest:
    tcp = deployment.compensation.linkage.place(_amounts(deployment, rest)).tcp
    missing, q = farness(tcp, goal), tuple(rest.poses.q[0].tolist())
    position = tuple(tcp[0, :3, 3].tolist())
    distance = math.dist(position, goal.position)
    if goal.rotation is not None:
        x, y, z = (tuple(row) for row in tcp[0, :3, :3].tolist())
        return Nearest(q, Goal(position, (x, y, z)), distance, float(missing.angle[0]))
    if goal.approach is not None:
        toward = tuple(tcp[0, :3, 2].tolist())
        return Nearest(q, Goal(position, None, toward), distance, float(missing.angle[0]))
    return Nearest(q, Goal(position), distance, 0.0)
