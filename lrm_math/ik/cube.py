"""The thesis's second method: search a cube of goals around the first correction (Conenna 2024, section 7.2)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.batch_equilibrium import settled
from lrm_math.ik.branches import every_branch
from lrm_math.ik.initial_guess import Drawn, first_guesses, nominal, taken
from lrm_math.ik.solver_context import Ask, Deployment, Found
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, rigid_amounts
from lrm_math.model.model import Model

REGION = 0.05
"""rad: to which known commands are rounded, so that the search has something to find."""
COARSE = 1e-3
"""m: equilibria in the cube are settled until the next step is below this; what is left then is a tenth of it. The best
one is settled to the end."""
SHRINK = 0.6
"""Side of each further cube over that of the one before."""


@dataclass(frozen=True, eq=False)
class Hit:
    """The best goal of a cube: amounts of the moving slots there (V,), and its distance from the one asked for (m)."""

    amounts: Array
    error: float


@dataclass(frozen=True)
class Cube:
    """Nominal inverse, one correction by the calibrated arm's error there, then the best of a cube of goals about it.

    The thesis corrects the position alone. With the orientation left as it was, nearly half of what the calibrated
    arm reaches has no nominal answer within the limits; so the orientation is corrected with it. While the best is
    further off than the grid is wide, the correction is made anew from there, with a smaller cube, at most `moves`
    times. Newton's method then takes the best to the goal.

    Where the first nominal answer leads nowhere, the next start is the neighbourhood of a command known from the direct
    method, if that has one; it is a neighbourhood only, so that the error of the best still tells what a cube can do.

    `side`: m. `points`: goals along each edge. `guesses`: how many starts are tried, each with its cubes, until one
    leads within the grid's width.
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

    def find(self, deployment: Deployment, ask: Ask) -> Found | None:
        """The polished best of the cube, and all other branches that can be found quickly."""
        others = every_branch(deployment, ask)
        hit = self.search(deployment, ask, None if others is None else others.q[deployment.usable(others)])
        if hit is None:
            return others
        polished, _ = deployment.solve_from(ask, hit.amounts[None])
        return replace(polished if others is None else polished.joined(others), error=hit.error)

    def search(self, deployment: Deployment, ask: Ask, commands: Array | None = None) -> Hit | None:
        """The best of the cubes; None where the arm does not settle or the nominal inverse has no answer.

        Starts are tried until one leads as close as the grid is wide.

        Args:
            commands: (K, n), rad, that are known to take the goal; see the class.
        """
        best: Hit | None = None
        guesses = itertools.islice(_promising(deployment, first_guesses(deployment, ask), commands), self.guesses)
        for drawn in guesses:
            hit = self._search_from(deployment, ask, drawn)
            best = hit if best is None or (hit is not None and hit.error < best.error) else best
            if best is not None and best.error <= self.width:
                break
        return best

    @property
    def width(self) -> float:
        """Of the grid (m)."""
        return self.side / (self.points - 1)

    def _search_from(self, deployment: Deployment, ask: Ask, drawn: Drawn) -> Hit | None:
        best: Hit | None = None
        around, rows = settled(deployment.model, deployment.poses(ask, drawn.q[None]), tolerance=COARSE)
        if not len(rows):
            return None
        for move in range(self.moves + 1):
            centre, rotation = _corrected(deployment, ask, drawn, around)
            q, valid = nominal(
                deployment,
                centre + self.side * SHRINK**move * _grid(self.points),
                rotation,
                around.poses.q[0],
            )
            poses = deployment.poses(ask, q[valid])
            rest, rows = settled(deployment.model, poses, _like(deployment.model, around, poses), COARSE)
            if not len(rows):
                break
            roughly = rest.one(int(np.linalg.norm(rest.true_tcp - ask.goal.position, axis=1).argmin()))
            around, rows = settled(deployment.model, roughly.poses, roughly.slots)
            if not len(rows):
                break
            error = math.dist(around.true_tcp[0], ask.goal.position)
            if best is not None and error >= best.error:
                break
            best = Hit(_amounts(deployment, around), error)
            if best.error <= self.width:
                break
            drawn = taken(deployment, around.poses.q[0])
        return best


def _promising(deployment: Deployment, guesses: Iterator[Drawn], commands: Array | None) -> Iterator[Drawn]:
    """The first guess; then the neighbourhoods of commands (K, n) that take the goal, if any are known; the others."""
    yield from itertools.islice(guesses, 1)
    for q in () if commands is None else np.round(commands / REGION) * REGION:
        yield taken(deployment, q)
    yield from guesses


def _corrected(deployment: Deployment, ask: Ask, drawn: Drawn, rest: Equilibrium) -> tuple[Array, Array]:
    """Position (3,) and orientation (3, 3) to ask of the nominal arm, by what the calibrated one was off."""
    position = drawn.position + ask.goal.position - rest.true_tcp[0]
    if ask.goal.rotation is None:
        return position, drawn.rotation
    seen = deployment.compensation.linkage.place(_amounts(deployment, rest)[None]).tcp[0, :3, :3]
    return position, np.array(ask.goal.rotation) @ seen.T @ drawn.rotation


@lru_cache(maxsize=8)
def _grid(points: int) -> Array:
    """(points³, 3), a cube of side 1 about zero."""
    return np.array(list(itertools.product(np.linspace(-0.5, 0.5, points), repeat=3)))


def _like(model: Model, rest: Equilibrium, poses: Poses) -> list[Number]:
    """Amounts of all slots at poses near one at rest, which give way as much as that one."""
    given = zip(rigid_amounts(model, poses), rest.slots, rigid_amounts(model, rest.poses), strict=True)
    return [rigid + (there - before) for rigid, there, before in given]


def _amounts(deployment: Deployment, rest: Equilibrium) -> Array:
    """(V,), the moving slots of a single pose."""
    return np.array([float(rest.slots[k]) for k in deployment.compensation.linkage.slots])
