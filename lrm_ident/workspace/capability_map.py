"""The capability map: how many of all orientations the tool can take, place by place (thesis section 3.1).

At the centre of every cell of a grid a set of orientations, spread evenly, goes through the inverse kinematics. The
share that has a solution within the limits, and clear of every shape if asked, is the cell's index (Zacharias, Borst
and Hirzinger 2007 count directions so). Unlike poses drawn in joint space it does not depend on how often an arm's
joints happen to lead somewhere, only on whether they can.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.progress import Tick, silent
from lrm_ident.workspace.voxel_grid import Area, Grid
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene, clearance
from lrm_math.errors import LrmError
from lrm_math.ik.nominal import solver_of
from lrm_math.ik.solver import NominalSolver

Mask = NDArray[np.bool_]
WHOLE_POSE = 6
AT_ONCE = 8000
"""Goals solved at once: as many as stay in the processor's cache."""


@dataclass(frozen=True)
class Figures:
    """What a map says of some cells, all between 0 and 1.

    Attributes:
        index: mean share of orientations that can be taken.
        directions: mean share of directions that the tool can point along, with any turn about itself.
        covered: share of the cells where at least one orientation can be taken.
    """

    index: float
    directions: float
    covered: float


@dataclass(frozen=True, eq=False)
class Capability:
    """The map of one arm.

    Attributes:
        index: (N,), share of orientations that can be taken at every cell's centre.
        directions: (N,), share of directions that the tool can point along there, with any turn about itself.
        goals: how many poses were asked for.
    """

    grid: Grid
    index: Array
    directions: Array
    goals: int

    @property
    def volume(self) -> float:
        """m³ where at least one orientation can be taken."""
        return float(np.count_nonzero(self.index)) * self.grid.cell_volume

    @property
    def everywhere(self) -> Figures:
        """Figures of the cells that can be reached at all; zero if there are none."""
        return self._figures(self.index > 0.0)

    def within(self, area: Area) -> Figures:
        """Figures of all cells with their centre in an area.

        Raises:
            LrmError: no cell has its centre there.
        """
        return self._figures(self.grid.inside(area))

    def score(self, areas: Sequence[Area]) -> float:
        """Mean index of all cells in any of the areas, 0 to 1: the thesis's total score over the number of goals.

        Raises:
            LrmError: no area, or no cell has its centre in one of them.
        """
        if not areas:
            raise LrmError("a score is the mean over areas; give one at least")
        return self._figures(np.any([self.grid.inside(area) for area in areas], axis=0)).index

    def _figures(self, cells: Mask) -> Figures:
        if not cells.any():
            return Figures(0.0, 0.0, 0.0)
        index, ways = self.index[cells], self.directions[cells]
        return Figures(float(index.mean()), float(ways.mean()), float((index > 0.0).mean()))


def pose_solver(arm: Arm) -> NominalSolver:
    """The inverse kinematics that a map goes through. Raises `LrmError` for an arm of fewer than six joints."""
    if arm.dof < WHOLE_POSE:
        raise LrmError(f"arm '{arm.name}' has {arm.dof} joints; a capability map asks for whole poses, which take six")
    return solver_of(arm)


def capability(
    arm: Arm, grid: Grid, tools: Array, scene: Scene | None = None, margin: float | None = None, progress: Tick = silent
) -> Capability:
    """The capability map of the nominal arm.

    Args:
        tools: (D, R, 3, 3), orientations of the tool: D directions with R turns about each.
        scene: the arm's shapes; poses in which two of them come closer than `margin` (m; None: the scene's own) do not
            count. None: all count.
        progress: told how many goals of all are done.

    Raises:
        LrmError: an arm with fewer than six joints, for which nearly every pose is out of reach; a margin below zero.
    """
    ways, rolls = tools.shape[:2]
    turns, centres, solver = tools.reshape(-1, 3, 3), grid.centres, pose_solver(arm)
    apart = 0.0 if scene is None else scene.margin_or(margin)
    index, directions = np.zeros((2, len(grid)))
    cells = max(1, AT_ONCE // len(turns))
    for start in range(0, len(grid), cells):
        here = centres[start : start + cells]
        p, R = np.repeat(here, len(turns), axis=0), np.tile(turns, (len(here), 1, 1))
        reached = _reached(solver, p, R, scene, apart).reshape(len(here), ways, rolls)
        index[start : start + cells] = reached.mean(axis=(1, 2))
        directions[start : start + cells] = reached.any(axis=2).mean(axis=1)
        progress((start + len(here)) * len(turns), len(grid) * len(turns))
    return Capability(grid, index, directions, len(grid) * len(turns))


def _reached(solver: NominalSolver, positions: Array, turns: Array, scene: Scene | None, margin: float) -> Mask:
    """(N,), whether a pose has a branch within the limits, and one that keeps clear."""
    found = solver.solve_batch(positions, turns)
    if scene is None:
        return found.solved
    clear = np.zeros(len(positions), dtype=np.bool_)
    for branch in range(found.valid.shape[1]):
        rows = np.flatnonzero(found.valid[:, branch] & ~clear)
        if len(rows):
            clear[rows] = clearance(scene, found.q[rows, branch]).distance >= margin
    return clear
