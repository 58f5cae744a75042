"""The methods of calibrated inverse kinematics: strategies over one engine. One more: a class, a name in `METHODS`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError, UnknownName
from lrm_math.ik.answer import NotConverged
from lrm_math.ik.calibrated_arm import (
    CalibratedArm,
    CancellationCheck,
    IkSolutions,
    Method,
    commands,
    initial_guesses,
    uncancelled,
)
from lrm_math.ik.goal import IkQuery, pose
from lrm_math.ik.kernel.kernel_model import frames_as_numbers, matrices


@dataclass(frozen=True)
class Direct:
    """True joint angles by Newton's method on the deflected arm from many seeds; commands follow from its loads."""

    name: str = "direct"

    def find(
        self, arm: CalibratedArm, query: IkQuery, check_cancelled: CancellationCheck = uncancelled
    ) -> IkSolutions | None:
        """All branches, or commands nearest to `near`; None if no seed leads to the goal."""
        check_cancelled()
        return commands(arm, query)


REGION = 0.05
"""rad: rounding of known commands, so that the search starts beside them."""
COARSE = 1e-3
"""m: equilibria in the cube are settled to this step; the remaining error is a tenth of it. The best settles fully."""
SHRINK = 0.6
"""Ratio of the sides of successive cubes."""


@dataclass(frozen=True, eq=False)
class CubeResult:
    """The best goal of a cube: slot amounts there (V,), and its distance from the query (m)."""

    slots: Array
    error: float


@dataclass(frozen=True)
class Cube:
    """Nominal inverse, one correction by the calibrated arm's error there, then the best of a cube of goals about it.

    The thesis corrects the position alone. With the orientation left as it was, nearly half of the calibrated arm's
    workspace has no nominal solution within the limits; so the orientation is corrected too. While the best is further
    off than the grid is wide, the correction is repeated from there with a smaller cube, at most `moves` times.
    Newton's method then takes the best to the goal.

    Where the first nominal solution leads nowhere, the next start is the neighbourhood of a command known to
    reach the goal; only its neighbourhood, so that the error of the best still shows what a cube can do.

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

    def find(
        self, arm: CalibratedArm, query: IkQuery, check_cancelled: CancellationCheck = uncancelled
    ) -> IkSolutions | None:
        """The best of the cube refined by Newton, and all other branches."""
        check_cancelled()
        others = commands(arm, query)
        commands_before = [] if others is None else [command.q for command in others.within]
        result = self.search(arm, query, commands_before, check_cancelled)
        if result is None:
            return others
        polished = tuple(arm.at_goal(query, result.slots))
        if others is None:
            return IkSolutions(polished, 0, result.error) if polished else None
        return replace(others, commands=(*polished, *others.commands), error=result.error)

    def search(
        self, arm: CalibratedArm, query: IkQuery, commands_before: Sequence[tuple[float, ...]] = (),
        check_cancelled: CancellationCheck = uncancelled,
    ) -> CubeResult | None:  # fmt: skip
        """The best of the cubes; None where the arm does not settle or the nominal inverse has no solution.

        `commands_before`: commands (rad) known to reach the goal; see the class. `check_cancelled`: called before each
        cube; what it raises ends the search, which may take seconds on a small board.
        """
        best: CubeResult | None = None
        for start in itertools.islice(_starts(arm, query, commands_before), self.guesses):
            result = self._search_from(arm, query, start, check_cancelled)
            best = result if best is None or (result is not None and result.error < best.error) else best
            if best is not None and best.error <= self.width:
                break
        return best

    @property
    def width(self) -> float:
        """Spacing of the grid (m)."""
        return self.side / (self.points - 1)

    def _search_from(
        self, arm: CalibratedArm, query: IkQuery, q: Array, check_cancelled: CancellationCheck
    ) -> CubeResult | None:
        best: CubeResult | None = None
        kernel, goal = arm.kernel(query.payload), np.array(query.goal.position)
        here = arm.equilibria(query.payload, q[None])
        for move in range(self.moves + 1):
            if not len(here.rows):
                break
            check_cancelled()
            centre = frames_as_numbers(*_corrected(query, arm.nominal_tool(q), matrices(here.tcp)[0]))
            _, known, _ = kernel.settle(q[None], np.zeros((1, kernel.joints)), here.slots, COARSE)
            target = goal + known[0, 9:] - here.tcp[0, 9:]
            side = self.side * SHRINK**move
            solutions = kernel.cube(
                arm.nominal_solver.packed, centre, side, self.points, target, COARSE, q, here.slots[0]
            )
            if solutions is None:
                break
            q, slots = solutions
            here = arm.equilibria(query.payload, q[None], start=slots[None])
            error = math.dist(here.tcp[0, 9:], goal) if len(here.rows) else math.inf
            if not math.isfinite(error) or (best is not None and error >= best.error):
                break
            best = CubeResult(here.slots[0], error)
            if error <= self.width:
                break
        return best


def _starts(arm: CalibratedArm, query: IkQuery, commands_before: Sequence[tuple[float, ...]]) -> Iterator[Array]:
    """The first guess; then neighbourhoods of commands known to reach the goal; then the other guesses."""
    guesses = initial_guesses(arm, query)
    yield from itertools.islice(guesses, 1)
    for q in commands_before:
        yield np.round(np.array(q) / REGION) * REGION
    yield from guesses


def _corrected(query: IkQuery, drawn: Array, tcp: Array) -> tuple[Array, Array]:
    """Position (1, 3) and orientation (1, 3, 3) for the arm as drawn, less the error of the tool (4, 4)."""
    position = drawn[:3, 3] + query.goal.position - tcp[:3, 3]
    if query.goal.rotation is None:
        return position[None], drawn[None, :3, :3]
    return position[None], (np.array(query.goal.rotation) @ tcp[:3, :3].T @ drawn[:3, :3])[None]


STILL = 1e-6
"""m: the error has settled when it changes by less."""


@dataclass(frozen=True)
class Iterative:
    """Nominal inverse, calibrated forward, then the goal mirrored by the error; repeated.

    Each new target is the goal minus the last error, not the last target minus the last error. Let the calibrated arm
    map a target x to x + d + D (x − goal); then errors follow e' = d − (1 + D) e. The first correction removes most of
    the error d, but it returns and settles at d / (2 + D), about half of it, if it settles at all.

    `enough`: m, an error that ends it. `most`: steps.
    """

    enough: float = 1e-3
    most: int = 100
    name: str = "iterative"

    def find(
        self, arm: CalibratedArm, query: IkQuery, check_cancelled: CancellationCheck = uncancelled
    ) -> IkSolutions | NotConverged | None:
        """The last iterate; None if the arm does not settle at the start."""
        q, errors = next(initial_guesses(arm, query)), list[float]()
        drawn, goal = arm.nominal_tool(q), np.array(query.goal.position)
        start = arm.unloaded_slots(q[None])
        for step in range(1, self.most + 1):
            check_cancelled()
            settled = arm.equilibria(query.payload, q[None], start=start, tolerance=0.1 * STILL)
            if not len(settled.rows):
                break
            error = settled.tcp[0, 9:] - goal
            errors.append(float(np.linalg.norm(error)))
            still = step > 2 and max(abs(errors[-1] - before) for before in errors[-3:-1]) < STILL
            if errors[-1] <= self.enough:
                return IkSolutions((arm.branch(q, settled.slots[0], (0,) * len(q)),), step)
            branches = arm.nominal_solver.branches(pose(drawn[:3, 3] - error, drawn[:3, :3]), q.tolist())
            if still or not branches:
                break
            answer = np.array(branches[0].q)
            start = settled.slots + arm.unloaded_slots(answer[None]) - arm.unloaded_slots(q[None])
            q = answer
        if not errors:
            return None
        return NotConverged(goal=query.goal, method=self.name, last=tuple(q.tolist()), errors=tuple(errors))


METHODS: dict[str, type[Cube | Direct | Iterative]] = {kind.name: kind for kind in (Cube, Direct, Iterative)}
DEFAULT: Method = Cube()
QUICKEST: Method = Direct()


@lru_cache(maxsize=64)
def method_named(name: str, **options: Any) -> Method:
    """A method with those of its settings that are among `options`, which may be other methods' too.

    Raises `UnknownName`, and `LrmError` for impossible settings.
    """
    if name not in METHODS:
        raise UnknownName("method of inverse kinematics", name, METHODS)
    settings = {field.name for field in fields(METHODS[name])}
    return METHODS[name](**{key: value for key, value in options.items() if key in settings})
