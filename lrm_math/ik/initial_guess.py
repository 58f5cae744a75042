"""The nominal inverse of a goal, from which the thesis's methods start."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.solver_context import Ask, Deployment
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames

PULLED = (0.0, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
"""Shares of the way to the arm's middle by which goals beyond the nominal arm's reach are pulled in."""
FROM_LIBRARY = 16


@dataclass(frozen=True, eq=False)
class Drawn:
    """Angles `q` (n,), rad, and the position (3,), m, and orientation (3, 3) that the nominal arm takes with them."""

    q: Array
    position: Array
    rotation: Array


def first_guesses(deployment: Deployment, ask: Ask) -> Iterator[Drawn]:
    """Nominal answers, nearest to `near` first, or else furthest from the limits; they may break them by a little.

    Goals that the nominal arm cannot take so are pulled inwards. After those come answers of the arm's look-alike, and
    the closest poses of the library. What the goal leaves free of the orientation is as the guess has it.
    """
    if ask.goal.rotation is None:
        for branch in deployment.drawing.lesser(ask.goal, ask.near):
            yield taken(deployment, np.array(branch.q))
    else:
        rotation, middle = np.array(ask.goal.rotation), deployment.likeness.middle
        shares = np.array(PULLED)[:, None]
        positions = (1.0 - shares) * ask.goal.position + shares * middle
        for some in (positions[:1], positions[1:]):
            batch = deployment.drawing.solve_batch(some, np.broadcast_to(rotation, (len(some), 3, 3)))
            row = int(batch.solved.argmax())
            if batch.solved[row]:
                for q in _in_order(deployment, ask, batch.q[row][batch.valid[row]]):
                    yield Drawn(q, some[row], rotation)
                break
        for q in deployment.likeness.seeds(ask.goal, ask.near).q:
            yield taken(deployment, q)
    for row in deployment.library.closest(ask.goal, FROM_LIBRARY):
        yield taken(deployment, deployment.library.q[row])


def nominal(
    deployment: Deployment, positions: Array, rotation: Array, near: Array, slack: float = 0.0
) -> tuple[Array, NDArray[np.bool_]]:
    """Nominal answers (N, n) for positions (N, 3) with one orientation, nearest to angles `near`; where there are any.

    They keep the limits but for `slack` (rad, at most `SLACK`).
    """
    batch = deployment.drawing.solve_batch(positions, np.broadcast_to(rotation, (len(positions), 3, 3)))
    row, number = np.nonzero(batch.valid)
    q, lower, upper = batch.q[row, number].T, deployment.band.lower - slack, deployment.band.upper + slack
    inside = ((q >= lower[:, None]) & (q <= upper[:, None])).all(axis=0)
    away = np.full(batch.valid.shape, np.inf)
    away[row, number] = np.where(inside, np.abs(q - near[:, None]).max(axis=0), np.inf)
    every, best = np.arange(len(positions)), away.argmin(axis=1)
    return batch.q[every, best], away[every, best] < np.inf


def taken(deployment: Deployment, q: Array) -> Drawn:
    """What the nominal arm takes with angles q (n,)."""
    chain = chain_of(deployment.model.arm)
    tcp = frames(chain, chain.values(q.tolist()), 1)[0, -1]
    return Drawn(q, tcp[:3, 3], tcp[:3, :3])


def _in_order(deployment: Deployment, ask: Ask, q: Array) -> Array:
    if ask.near is not None:
        return np.asarray(q[np.abs(q - ask.near).max(axis=1).argsort()])
    limits = deployment.limits
    margin = np.minimum(q - limits.lower, np.array(limits.upper) - q).min(axis=1)
    return np.asarray(q[(-margin).argsort()])
