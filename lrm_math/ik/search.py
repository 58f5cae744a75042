"""Searches that every method shares: all commands that reach a goal, the nearest to one, and nominal guesses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.answer import Nearest
from lrm_math.ik.calibrated_arm import CalibratedArm
from lrm_math.ik.kernel.kernel_model import matrices
from lrm_math.ik.solutions import IkQuery, IkSolution, IkSolutions

REACHED = 0.01
"""m: a goal that the nearest command misses by less is tried once more from there."""
SAME = 1e-6
"""rad: commands that differ by no more are one."""
RETRACTIONS = (0.0, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16)
"""Shares of the distance to the second joint by which goals beyond the nominal arm's reach are retracted."""


def commands(arm: CalibratedArm, query: IkQuery) -> IkSolutions | None:
    """All branches that the seeds lead to, or commands nearest to `near`; None if no seed leads to the goal.

    Seeds are the branches of an equivalent arm's closed form, null-space and fold seeds, and poses of the library (see
    section 9 of `kernel/ik_kernel.c`). Where they lead to nothing within the limits, Newton's method starts from the
    nearest command, if it is within 1 cm, and from the nominal arm's branches.
    """
    if not arm.library.reach_ball.contains(query.goal.position):
        return None
    found = arm.branches(query)
    if not found.within:
        more = _from_elsewhere(arm, query, found)
        found = replace(found, commands=(*more, *(c for c in found.commands if not _among(c, more))))
    return found if found.commands else None


def _from_elsewhere(arm: CalibratedArm, query: IkQuery, found: IkSolutions) -> tuple[IkSolution, ...]:
    """Newton's method from the nearest command to the goal, or else from the nominal arm's branches."""
    out: tuple[IkSolution, ...] = ()
    with suppress(LrmError):
        closest = nearest(arm, query, tuple(command.q for command in found.beyond))
        if closest.error <= REACHED:
            out = _from_commands(arm, query, [closest.q])
    branches = () if out else arm.nominal_solver.branches(query.goal, query.near)
    return out or _from_commands(arm, query, [branch.q for branch in branches])


def _from_commands(arm: CalibratedArm, query: IkQuery, starts: Sequence[tuple[float, ...]]) -> tuple[IkSolution, ...]:
    if not starts:
        return ()
    out: list[IkSolution] = []
    for slots in arm.equilibria(query, np.array(starts)).slots:
        out.extend(c for c in arm.at_goal(query, slots) if not _among(c, out))
    return tuple(out)


def _among(command: IkSolution, others: Sequence[IkSolution]) -> bool:
    """Whether a command is one of others up to the kernel's tolerance."""
    return any(np.abs(np.subtract(command.q, other.q)).max() <= SAME for other in others)


@lru_cache(maxsize=4)
def nearest(arm: CalibratedArm, query: IkQuery, starts: tuple[tuple[float, ...], ...] = ()) -> Nearest:
    """Least squares of distance (m) and scaled rotation over the commands within the limits.

    `starts`: commands (rad) to start from, beside the closest poses of the library. Of effects that the kernel does not
    know, the linear part decides about the command; its distance is that of the whole model.

    Raises `LrmError`: the arm does not settle anywhere near.
    """
    found = arm.kernel(query.payload).nearest(query.goal, starts)
    if found is not None:
        settled = arm.equilibria(query, np.array([found[0]]))
        if len(settled.rows):
            return Nearest.at(found[0], query.goal, matrices(settled.tcp)[0])
    raise LrmError("the arm comes to rest in no pose near this goal; its compliances may be wrong")


def initial_guesses(arm: CalibratedArm, query: IkQuery) -> Iterator[Array]:
    """Nominal solutions (n,), nearest to `near` first, or else furthest from the limits; a little beyond them too.

    Goals beyond the nominal arm's reach are retracted. What the goal leaves free of the orientation is as the guess has
    it. At last the closest poses of the library.
    """
    inwards = np.array(arm.nominal_solver.second_axis) - query.goal.position
    for share in RETRACTIONS:
        position = np.array(query.goal.position) + share * inwards
        goal = replace(query.goal, position=tuple(position.tolist()))
        branches = arm.nominal_solver.branches(goal, query.near)
        for branch in branches:
            yield np.array(branch.q)
        if branches:
            break
    found = arm.library.tcp[:, :3, 3] - query.goal.position
    for row in np.argsort(np.linalg.norm(found, axis=1))[:16]:
        yield arm.library.q[row]
