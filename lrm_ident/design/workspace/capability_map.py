"""Capability map: the share of orientations that the tool can take, by voxel (thesis section 3.1).

The inverse kinematics is solved for a uniform orientation grid at every voxel's centre. The share with a solution
within the joint limits, and optionally free of collisions, is the voxel's reachability index (Zacharias, Borst &
Hirzinger 2007, who count directions). Unlike sampling in joint space it does not depend on the density of joint angles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_ident.design.workspace.voxel_grid import Area, Mask, VoxelGrid
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene, clearance
from lrm_math.errors import LrmError
from lrm_math.ik.nominal import NominalSolver

BATCH = 8000  # goals solved at once: as many as fit into the processor's cache


@dataclass(frozen=True)
class CapabilitySummary:
    """Means over some voxels, all between 0 and 1.

    Attributes:
        index: mean reachability index.
        directions: mean share of directions reachable with any roll.
        covered: share of the voxels with a reachable orientation.
    """

    index: float
    directions: float
    covered: float


@dataclass(frozen=True, eq=False)
class CapabilityMap:
    """The map of one arm.

    Attributes:
        index: (N,), reachability index: share of reachable orientations at every voxel's centre.
        directions: (N,), share of directions reachable there with any roll.
        goals: number of poses solved.
    """

    grid: VoxelGrid
    index: Array
    directions: Array
    goals: int

    @property
    def volume(self) -> float:
        """Volume of the voxels with a reachable orientation (m³)."""
        return float(np.count_nonzero(self.index)) * self.grid.cell_volume

    @property
    def everywhere(self) -> CapabilitySummary:
        """Summary of the voxels with a reachable orientation; zero if there are none."""
        return self._summary(self.index > 0.0)

    def within(self, area: Area) -> CapabilitySummary:
        """Summary of all voxels with their centre in an area. Raises `LrmError` if there are none."""
        return self._summary(self.grid.inside(area))

    def score(self, areas: Sequence[Area]) -> float:
        """Mean index of all voxels in any of the areas, 0 to 1: the thesis's total score over the number of goals.

        Raises `LrmError`: no area, or an area without a voxel's centre.
        """
        if not areas:
            raise LrmError("a score is the mean over areas; give one at least")
        return self._summary(np.any([self.grid.inside(area) for area in areas], axis=0)).index

    def _summary(self, cells: Mask) -> CapabilitySummary:
        if not cells.any():
            return CapabilitySummary(0.0, 0.0, 0.0)
        index, directions = self.index[cells], self.directions[cells]
        return CapabilitySummary(float(index.mean()), float(directions.mean()), float((index > 0.0).mean()))


def pose_solver(arm: Arm) -> NominalSolver:
    """The inverse kinematics of the map. Raises `LrmError` for an arm of fewer than six joints."""
    if arm.dof < 6:
        raise LrmError(f"arm '{arm.name}' has {arm.dof} joints; a capability map needs whole poses, which take six")
    return NominalSolver.of(arm)


def capability_map(
    arm: Arm,
    grid: VoxelGrid,
    tools: Array,
    scene: Scene | None = None,
    margin: float | None = None,
    progress: OnProgress = silent,
) -> CapabilityMap:
    """The capability map of the nominal arm.

    Args:
        tools: (D, R, 3, 3), orientations of the tool: D directions with R rolls each.
        scene: collision shapes; configurations with a clearance below `margin` (m; None: the scene's own) are
            infeasible. None: no collision check.
        progress: called with the numbers of goals done and in total.

    Raises `LrmError`: an arm with fewer than six joints, or a margin below zero.
    """
    directions_count, rolls = tools.shape[:2]
    orientations, centres, solver = tools.reshape(-1, 3, 3), grid.centres, pose_solver(arm)
    clear_by = 0.0 if scene is None else scene.margin_or_default(margin)
    index, directions = np.zeros((2, len(grid)))
    goals = len(grid) * len(orientations)
    cells = max(1, BATCH // len(orientations))
    for start in range(0, len(grid), cells):
        here = centres[start : start + cells]
        p, R = np.repeat(here, len(orientations), axis=0), np.tile(orientations, (len(here), 1, 1))
        reached = _reached(solver, p, R, scene, clear_by).reshape(len(here), directions_count, rolls)
        index[start : start + cells] = reached.mean(axis=(1, 2))
        directions[start : start + cells] = reached.any(axis=2).mean(axis=1)
        progress((start + len(here)) * len(orientations), goals)
    return CapabilityMap(grid, index, directions, goals)


def _reached(solver: NominalSolver, positions: Array, orientations: Array, scene: Scene | None, margin: float) -> Mask:
    """(N,), whether a pose has a branch within the joint limits and free of collisions."""
    solved = solver.solve_batch(positions, orientations)
    if scene is None:
        return solved.solved
    clear = np.zeros(len(positions), dtype=np.bool_)
    for branch in range(solved.valid.shape[1]):
        rows = np.flatnonzero(solved.valid[:, branch] & ~clear)
        if len(rows):
            clear[rows] = clearance(scene, solved.q[rows, branch]).distance >= margin
    return clear
