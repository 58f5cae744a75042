"""The command within the limits whose tool frame is nearest to an unreachable goal."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.answer import Nearest
from lrm_math.ik.batch_equilibrium import batch_equilibrium
from lrm_math.ik.descent import LinearisedArm, descend
from lrm_math.ik.goal import Goal
from lrm_math.ik.library import COARSE
from lrm_math.ik.multi_start import separated
from lrm_math.ik.newton import CHAR_LENGTH
from lrm_math.ik.pose_error import pose_error
from lrm_math.ik.solver_context import IkQuery, SolverContext
from lrm_math.kinematics.chain import Number
from lrm_math.model.equilibrium import Equilibrium

STARTS, ROUGH = 16, 8
"""Number of library starts, and steps from each until only the best go on."""
KEPT, APART = 3, 0.1
"""Number that go on, and their least distance from each other (rad)."""
ROUNDS, FINE = 6, 8
"""Recomputations of the equilibrium, and steps between them."""
DROP_RATIO = 1.1
"""Candidates with an error above this multiple of the least, and above it by `ROUGHNESS`, are dropped."""
ROUGHNESS = 3e-3
"""m: change of the deflections by a few steps."""
ENOUGH, FAR = 1e-3, 0.1
"""A round that lessens an error (m), capped at `FAR`, by no larger a share is the last."""


def nearest(context: SolverContext, query: IkQuery, starts: Array) -> Nearest:
    """Least squares of distance (m) and scaled rotation over the commands within the limits.

    Newton's method from the closest poses of the library and from `starts` (K, n), commands (rad). The derivatives of
    the deflections are those at the start until the best few are known, and recomputed every few steps for these.

    Raises `LrmError`: the arm does not settle anywhere near.
    """
    found = nearest_from_library(context, query)
    if len(starts):
        refined = _refined(context, query, np.clip(starts, context.bounds.lower, context.bounds.upper))
        other = None if refined is None else _nearest_at(context, query.goal, refined)
        found = min((some for some in (found, other) if some is not None), key=_error, default=None)
    if found is None:
        raise LrmError("the arm comes to rest in no pose near this goal; its compliances may be wrong")
    return found


@lru_cache(maxsize=2)
def nearest_from_library(context: SolverContext, query: IkQuery) -> Nearest | None:
    """`nearest` without other starts; None where the arm does not settle.

    Cached, since a method that gives a goal up has computed it for the answer.
    """
    library = context.library
    rows = library.closest(query.goal, STARTS)
    return _from(context, query, library.q[rows], library.amounts[rows])


def error_exceeds(context: SolverContext, query: IkQuery, by: float) -> bool:
    """Whether the nearest command leaves an error above `by` (m)."""
    found = nearest_from_library(context, query)
    return found is None or _error(found) > by


def _error(found: Nearest) -> float:
    """m, rotation included."""
    return math.hypot(found.distance, CHAR_LENGTH * found.angle)


def _from(context: SolverContext, query: IkQuery, q: Array, amounts: Array) -> Nearest | None:
    """The nearest from commands (K, n) and slot amounts (K, V) there; None if none settles."""
    rigid = np.zeros((len(q), amounts.shape[1], q.shape[1]))
    rigid[:, context.linkage.joints, np.arange(q.shape[1])] = 1.0
    q, error = descend(context, query.goal, LinearisedArm(q, amounts, rigid), ROUGH)
    order = separated(q, np.argsort(error), APART)
    for rows in (order[:KEPT], order[KEPT:]):
        best = _refined(context, query, q[rows]) if len(rows) else None
        if best is not None:
            return _nearest_at(context, query.goal, best)
    return None


def _refined(context: SolverContext, query: IkQuery, q: Array) -> Equilibrium | None:
    """The equilibrium of least error, from the best of commands (K, n); None if none settles."""
    start: list[Number] | None = None
    best, least = None, math.inf
    before = np.full(len(q), np.inf)
    for _ in range(ROUNDS):
        rest, rows = batch_equilibrium(context.model, context.poses(query, q), start, COARSE)
        if not len(rows):
            break
        arm = _linearised(context, rest)
        error = np.sqrt(pose_error(context.linkage.forward(arm.amounts).tcp, query.goal).square)
        if error.min() < least:
            least, best = float(error.min()), rest.one(int(error.argmin()))
        going = (error <= DROP_RATIO * least + ROUGHNESS) & (
            before[rows] - error >= ENOUGH * np.minimum(error, FAR) + COARSE
        )
        if not going.any():
            break
        arm, before = arm.take(going), error[going]
        q, _ = descend(context, query.goal, arm, FINE)
        start = context.chain_amounts(arm.at(q))
    if best is None:
        return None
    last, rows = batch_equilibrium(context.model, best.poses)
    return last if len(rows) else None


def _linearised(context: SolverContext, rest: Equilibrium) -> LinearisedArm:
    """Poses at rest, and the derivatives of the moving slots by commands, from the linearised loads."""
    joint_laws, linkage = context.joint_laws, context.linkage
    amounts = context.slot_amounts(rest)
    state, masses = linkage.forward(amounts), joint_laws.mass_moments(float(rest.poses.payload[0]))
    loads = linkage.loads(state, masses)
    count, slots = amounts.shape
    springs = np.repeat(joint_laws.compliances[None], count, axis=0)
    springs[:, linkage.others] = joint_laws.others_compliance(rest.poses, loads.tau)
    gives = springs @ linkage.load_derivatives(state, masses, loads).transpose(2, 0, 1)
    by_joint = np.eye(slots)[:, linkage.joints]
    follow = np.linalg.solve(np.eye(slots) - gives, np.tile(by_joint, (count, 1, 1)))
    return LinearisedArm(rest.poses.q, amounts, np.asarray(follow))


def _nearest_at(context: SolverContext, goal: Goal, rest: Equilibrium) -> Nearest:
    tcp = context.linkage.forward(context.slot_amounts(rest)).tcp
    reached, angle = goal.same_kind_at(tcp[0]), float(pose_error(tcp, goal).angle[0])
    distance = math.dist(reached.position, goal.position)
    return Nearest(tuple(rest.poses.q[0].tolist()), reached, distance, angle)
