"""The thesis's second method: search a cube of goals centre_rest the first correction (Conenna 2024, section 7.2)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.batch_equilibrium import batch_equilibrium
from lrm_math.ik.branches import every_branch
from lrm_math.ik.initial_guess import NominalPose, initial_guesses, nominal_pose, nominal_solutions
from lrm_math.ik.solver_context import CommandBatch, IkQuery, SolverContext
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, rigid_amounts
from lrm_math.model.model import Model

REGION = 0.05
"""rad: rounding of known commands, so that the search starts beside them."""
COARSE = 1e-3
"""m: equilibria in the cube are settled to this step; the remaining error is a tenth of it. The best settles fully."""
SHRINK = 0.6
"""Ratio of the sides of successive cubes."""


@dataclass(frozen=True, eq=False)
class CubeResult:
    """The best goal of a cube: slot amounts there (V,), and its distance from the query (m)."""

    amounts: Array
    error: float


@dataclass(frozen=True)
class Cube:
    """Nominal inverse, one correction by the calibrated arm's error there, then the best of a cube of goals about it.

    The thesis corrects the position alone. With the orientation left as it was, nearly half of the calibrated arm's
    workspace has no nominal solution within the limits; so the orientation is corrected too. While the best is further
    off than the grid is wide, the correction is repeated from there with a smaller cube, at most `moves` times.
    Newton's method then takes the best to the goal.

    Where the first nominal solution leads nowhere, the next start is the neighbourhood of a command known from the
    direct method; only its neighbourhood, so that the error of the best still shows what a cube can do.

    `side`: m. `points`: goals along each edge. `guesses`: maximum number of starts, each with its cubes.
    """

    side: float = 0.01
    points: int = 11
    moves: int = 4
    guesses: int = 24
    name: str = "cube"

    def __post_init__(self) -> None:
        if not (self.side > 0.0 and self.points >= 2 and self.moves >= 0 and self.guesses >= 1):
            raise LrmError(
                f"cube: side {self.side} m, {self.points} points, {self.moves} moves, {self.guesses} guesses; "
                "should be a side above 0, 2 or more points, 0 or more moves and 1 or more guesses"
            )

    def find(self, context: SolverContext, query: IkQuery) -> CommandBatch | None:
        """The best of the cube refined by Newton, and all other branches of the extended search."""
        others = every_branch(context, query)
        result = self.search(context, query, None if others is None else others.q[context.within_limits(others)])
        if result is None:
            return others
        polished, _ = context.solve_from(query, result.amounts[None])
        return replace(polished if others is None else polished.joined(others), error=result.error)

    def search(self, context: SolverContext, query: IkQuery, commands: Array | None = None) -> CubeResult | None:
        """The best of the cubes; None where the arm does not settle or the nominal inverse has no solution.

        `commands`: (K, n), rad, that are known to reach the goal; see the class.
        """
        best: CubeResult | None = None
        guesses = itertools.islice(_starts(context, initial_guesses(context, query), commands), self.guesses)
        for nominal in guesses:
            result = self._search_from(context, query, nominal)
            best = result if best is None or (result is not None and result.error < best.error) else best
            if best is not None and best.error <= self.width:
                break
        return best

    @property
    def width(self) -> float:
        """Spacing of the grid (m)."""
        return self.side / (self.points - 1)

    def _search_from(self, context: SolverContext, query: IkQuery, nominal: NominalPose) -> CubeResult | None:
        best: CubeResult | None = None
        centre_rest, rows = batch_equilibrium(context.model, context.poses(query, nominal.q[None]), tolerance=COARSE)
        if not len(rows):
            return None
        for move in range(self.moves + 1):
            centre, rotation = _corrected(context, query, nominal, centre_rest)
            q, valid = nominal_solutions(
                context, centre + self.side * SHRINK**move * _grid(self.points), rotation, centre_rest.poses.q[0]
            )
            poses = context.poses(query, q[valid])
            rest, rows = batch_equilibrium(context.model, poses, _like(context.model, centre_rest, poses), COARSE)
            if not len(rows):
                break
            roughly = rest.one(int(np.linalg.norm(rest.true_tcp - query.goal.position, axis=1).argmin()))
            centre_rest, rows = batch_equilibrium(context.model, roughly.poses, roughly.slots)
            if not len(rows):
                break
            error = math.dist(centre_rest.true_tcp[0], query.goal.position)
            if best is not None and error >= best.error:
                break
            best = CubeResult(context.slot_amounts(centre_rest)[0], error)
            if best.error <= self.width:
                break
            nominal = nominal_pose(context, centre_rest.poses.q[0])
        return best


def _starts(context: SolverContext, guesses: Iterator[NominalPose], commands: Array | None) -> Iterator[NominalPose]:
    """The first guess; then neighbourhoods of commands (K, n) known to reach the goal; then the other guesses."""
    yield from itertools.islice(guesses, 1)
    for q in () if commands is None else np.round(commands / REGION) * REGION:
        yield nominal_pose(context, q)
    yield from guesses


def _corrected(context: SolverContext, query: IkQuery, nominal: NominalPose, rest: Equilibrium) -> tuple[Array, Array]:
    """Position (3,) and orientation (3, 3) for the nominal arm, corrected by the calibrated arm's error."""
    position = nominal.position + query.goal.position - rest.true_tcp[0]
    if query.goal.rotation is None:
        return position, nominal.rotation
    tcp_rotation = context.linkage.forward(context.slot_amounts(rest)).tcp[0, :3, :3]
    return position, np.array(query.goal.rotation) @ tcp_rotation.T @ nominal.rotation


@lru_cache(maxsize=8)
def _grid(points: int) -> Array:
    """(points³, 3), a cube of side 1 about zero."""
    return np.array(list(itertools.product(np.linspace(-0.5, 0.5, points), repeat=3)))


def _like(model: Model, rest: Equilibrium, poses: Poses) -> list[Number]:
    """Amounts of all slots at poses near one at rest, with the same deflections."""
    given = zip(rigid_amounts(model, poses), rest.slots, rigid_amounts(model, rest.poses), strict=True)
    return [rigid + (there - before) for rigid, there, before in given]
