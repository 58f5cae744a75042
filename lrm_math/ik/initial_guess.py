"""Nominal solutions of a goal, from which the methods of the thesis start."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.solver_context import IkQuery, SolverContext
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames

RETRACTIONS = (0.0, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
"""Shares of the distance to the arm's middle by which goals beyond the nominal arm's reach are retracted."""
FROM_LIBRARY = 16


@dataclass(frozen=True, eq=False)
class NominalPose:
    """Angles `q` (n,), rad, and the nominal tool position (3,), m, and orientation (3, 3)."""

    q: Array
    position: Array
    rotation: Array


def initial_guesses(context: SolverContext, query: IkQuery) -> Iterator[NominalPose]:
    """Nominal solutions, nearest to `near` first, or else furthest from the limits; they may break them by a little.

    Goals beyond the nominal arm's reach are retracted. Then solutions of the equivalent arm, and the closest poses of
    the library. What the goal leaves free of the orientation is as the guess has it.
    """
    if query.goal.rotation is None:
        for branch in context.nominal_solver.partial_branches(query.goal, query.near):
            yield nominal_pose(context, np.array(branch.q))
    else:
        rotation, middle = np.array(query.goal.rotation), context.equivalent_arm.middle
        shares = np.array(RETRACTIONS)[:, None]
        positions = (1.0 - shares) * query.goal.position + shares * middle
        for some in (positions[:1], positions[1:]):
            batch = context.nominal_solver.solve_batch(some, np.broadcast_to(rotation, (len(some), 3, 3)))
            row = int(batch.solved.argmax())
            if batch.solved[row]:
                for q in _in_order(context, query, batch.q[row][batch.valid[row]]):
                    yield NominalPose(q, some[row], rotation)
                break
        for q in context.equivalent_arm.seeds(query.goal, query.near).q:
            yield nominal_pose(context, q)
    for row in context.library.closest(query.goal, FROM_LIBRARY):
        yield nominal_pose(context, context.library.q[row])


def nominal_solutions(
    context: SolverContext, positions: Array, rotation: Array, near: Array, slack: float = 0.0
) -> tuple[Array, NDArray[np.bool_]]:
    """Nominal solutions (N, n) for positions (N, 3) with one orientation, nearest to `near`; and which exist (N,).

    They keep the limits with a tolerance `slack` (rad, at most `SLACK`).
    """
    batch = context.nominal_solver.solve_batch(positions, np.broadcast_to(rotation, (len(positions), 3, 3)))
    row, number = np.nonzero(batch.valid)
    q, lower, upper = batch.q[row, number].T, context.bounds.lower - slack, context.bounds.upper + slack
    inside = ((q >= lower[:, None]) & (q <= upper[:, None])).all(axis=0)
    away = np.full(batch.valid.shape, np.inf)
    away[row, number] = np.where(inside, np.abs(q - near[:, None]).max(axis=0), np.inf)
    every, best = np.arange(len(positions)), away.argmin(axis=1)
    return batch.q[every, best], away[every, best] < np.inf


def nominal_pose(context: SolverContext, q: Array) -> NominalPose:
    """The nominal tool frame at angles q (n,)."""
    chain = chain_of(context.model.arm)
    tcp = frames(chain, chain.values(q.tolist()), 1)[0, -1]
    return NominalPose(q, tcp[:3, 3], tcp[:3, :3])


def _in_order(context: SolverContext, query: IkQuery, q: Array) -> Array:
    if query.near is not None:
        return np.asarray(q[np.abs(q - query.near).max(axis=1).argsort()])
    limits = context.limits
    margin = np.minimum(q - limits.lower, np.array(limits.upper) - q).min(axis=1)
    return np.asarray(q[(-margin).argsort()])
