"""The command within the limits that comes nearest to a goal which cannot be taken."""

from __future__ import annotations

import math

import numpy as np

from lrm_math.chain import Array
from lrm_math.errors import LrmError
from lrm_math.ik.answer import Nearest
from lrm_math.ik.deployment import Ask, Deployment
from lrm_math.ik.goal import Goal
from lrm_math.ik.newton import LEVER, Aim
from lrm_math.ik.settled import settled

STARTS, MOST_STEPS = 12, 60
STILL = 1e-10
"""rad: a step that moves no joint further ends the descent."""


def nearest(deployment: Deployment, ask: Ask, starts: Array) -> Nearest:
    """Least squares of distance (m) and turn (rad, times `newton.LEVER`) over the commands within the limits.

    From `starts` (K, n), commands (rad), and from the closest poses of the library: Levenberg and Marquardt's method
    on the rigid calibrated chain, commands kept within the limits on the way; loads follow from step to step.

    Raises:
        LrmError: the arm comes to rest nowhere near, so there is nothing to propose.
    """
    aim = Aim.of(ask.goal)
    library = deployment.library
    q = np.concatenate([starts, library.q[library.closest(ask.goal, STARTS)]])
    rest, rows = settled(deployment.model, deployment.poses(ask, _descend(deployment, ask, aim, q)))
    if not len(rows):
        raise LrmError("the arm comes to rest in no pose near this goal; its compliances may be wrong")
    slots = deployment.compensation.linkage.slots
    amounts = np.array([np.broadcast_to(rest.slots[k], len(rows)) for k in slots]).T
    tcp = deployment.compensation.linkage.place(amounts).tcp
    best = int(np.einsum("ki,ki->k", *[aim.error(tcp)] * 2).argmin())
    return _value(ask.goal, rest.poses.q[best], tcp[best])


def _descend(deployment: Deployment, ask: Ask, aim: Aim, q: Array) -> Array:
    """(K, n), commands at a least error within the limits, one per start (K, n)."""
    compensation, linkage = deployment.compensation, deployment.compensation.linkage
    lower, upper = np.array(deployment.limits.lower), np.array(deployment.limits.upper)
    q = np.clip(q, lower, upper)
    burden = compensation.burden(deployment.poses(ask, q[:1]))
    amounts = np.repeat(compensation.steady[None], len(q), axis=0)
    amounts[:, linkage.joints] = deployment.zero + q
    damping, before, kept = np.full(len(q), 1e-3), np.full(len(q), np.inf), q
    for _ in range(MOST_STEPS):
        for _ in range(2):
            placed = linkage.place(amounts)
            tau = linkage.loads(placed, burden).tau
            amounts[:, linkage.others] = compensation.others(deployment.poses(ask, q), tau).T
            real = amounts[:, linkage.joints]
            amounts[:, linkage.joints] = real + q - compensation.command(deployment.poses(ask, q), tau, real)
        placed = linkage.place(amounts)
        error = aim.error(placed.tcp)
        J = aim.rows_of(linkage.jacobian(placed), placed.tcp)[:, :, linkage.joints]
        now = np.einsum("ki,ki->k", error, error)
        better = now < before
        kept, before = np.where(better[:, None], q, kept), np.where(better, now, before)
        damping = np.clip(np.where(better, 0.3 * damping, 10.0 * damping), 1e-9, 1e3)
        pull = np.einsum("kin,ki->kn", J, error)
        stuck = ((q <= lower) & (pull < 0.0)) | ((q >= upper) & (pull > 0.0))
        J = np.where(stuck[:, None], 0.0, J)
        normal = J.transpose(0, 2, 1) @ J + damping[:, None, None] * np.eye(q.shape[1])
        step = np.linalg.solve(normal, np.where(stuck, 0.0, pull)[:, :, None])[:, :, 0]
        moved = np.clip(q + step, lower, upper)
        if np.abs(moved - q).max() < STILL:
            break
        amounts[:, linkage.joints] += moved - q
        q = moved
    return kept


def _value(goal: Goal, q: Array, tcp: Array) -> Nearest:
    position = tuple(tcp[:3, 3].tolist())
    distance = math.dist(position, goal.position)
    off = Aim.of(goal).error(tcp[None])[0, 3:] / LEVER
    if goal.rotation is not None:
        x, y, z = (tuple(row) for row in tcp[:3, :3].tolist())
        angle = 2.0 * math.atan(0.5 * float(np.linalg.norm(off)))
        return Nearest(tuple(q.tolist()), Goal(position, (x, y, z)), distance, angle)
    if goal.approach is not None:
        toward = tuple(tcp[:3, 2].tolist())
        return Nearest(tuple(q.tolist()), Goal(position, None, toward), distance, float(np.linalg.norm(off)))
    return Nearest(tuple(q.tolist()), Goal(position), distance, 0.0)
