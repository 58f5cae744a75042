"""Path planning: RRT-Connect in joint space (Kuffner & LaValle 2000), then shortcuts (Geraerts & Overmars 2007).

All pieces of a path are straight moves that `straight_move` proves free. The result depends only on the arguments: the
same random generator in the same state gives the same path, and effort is counted in samples, not in seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from lrm_math.arrays import Array
from lrm_math.collision.scene import ClosestPair, Scene
from lrm_math.collision.straight_move import RESOLUTION, MotionClearance

STEP = 0.4
"""rad: extension step of a tree; lengths of moves are Euclidean norms of joint angles."""
BACK = 0.02
"""rad: a branch ends this far before the collision that stops it, so that others can start from there."""
SHORTCUTS = 60
LIMIT_ROUND_OFF = 1e-9

Check: TypeAlias = Callable[[Array, Array, float], MotionClearance]
"""Collision check of the straight move between two poses (n,) in rad, with a margin (m)."""
Reason: TypeAlias = Literal[
    "start outside limits", "goal outside limits", "start in collision", "goal in collision", "not found"
]


@dataclass(frozen=True)
class NoPath:
    """Reason why there is no path.

    Attributes:
        joint: the first joint (from 1) beyond its limits, or None.
        closest: the two bodies that are too close: at the start, at the goal, or, if nothing was found, where the
            straight move first collides. None where limits are the reason.
        margin: m, required.
        samples: random poses tried.
    """

    why: Reason
    joint: int | None
    closest: ClosestPair | None
    margin: float
    samples: int

    def __str__(self) -> str:
        if self.closest is None:
            return f"no path: joint {self.joint}: {self.why}"
        tried = f" after {self.samples} samples, and on the straight way" if self.why == "not found" else ":"
        bodies = f"{self.closest.first} and {self.closest.second} are {self.closest.distance * 1e3:.1f} mm apart"
        return f"no path: {self.why}{tried} {bodies}; {self.margin * 1e3:.1f} mm must be kept"


def plan(
    scene: Scene, start: ArrayLike, goal: ArrayLike, rng: np.random.Generator, margin: float, samples: int, check: Check
) -> Array | NoPath:
    """A collision-free path from start to goal, each (n,) in rad, or why there is none.

    The path: straight moves through waypoints (M, n) in rad, start and goal included. The straight move is tried first.
    Other paths keep `straight_move.RESOLUTION` more than the margin, so that every part of them passes `check` again.

    Args:
        margin: m. samples: random poses to try before giving up.
        check: collision check of the straight pieces; it may be stricter than that of the rigid arm.

    Raises:
        LrmError: start or goal of the wrong shape or not finite.
    """
    a, b, limits = scene.pose(start), scene.pose(goal), scene.limits
    ends: tuple[tuple[Array, Reason, Reason], ...] = (
        (a, "start outside limits", "start in collision"),
        (b, "goal outside limits", "goal in collision"),
    )
    for q, outside, _ in ends:
        beyond = np.flatnonzero((q < limits[0] - LIMIT_ROUND_OFF) | (q > limits[1] + LIMIT_ROUND_OFF))
        if len(beyond):
            return NoPath(outside, int(beyond[0]) + 1, None, margin, 0)
    straight = check(a, b, margin)
    if straight.free:
        return np.array([a, b])
    for q, _, close in ends:
        closest = scene.closest(q)
        if closest.distance < margin + RESOLUTION:
            return NoPath(close, None, closest, margin, 0)
    path_found = _connect(check, a, b, limits, margin + RESOLUTION, rng, samples)
    if path_found is None:
        closest = ClosestPair(straight.distance, straight.first, straight.second)
        return NoPath("not found", None, closest, margin, samples)
    return _shortened(check, path_found, margin + RESOLUTION, rng)


class _Tree:
    """A tree of poses reached from a root by free moves, with the parent of each."""

    def __init__(self, root: Array) -> None:
        self.poses, self.parents = root[None], [0]

    def grow(self, check: Check, margin: float, target: Array, furthest: float) -> tuple[int, bool]:
        """Extends from the nearest pose straight towards a target by at most `furthest` (rad), a pose at every `STEP`.

        Returns the last pose, and whether it is the target.
        """
        nearest = int(np.linalg.norm(self.poses - target, axis=1).argmin())
        root = self.poses[nearest]
        length = float(np.linalg.norm(target - root))
        aim = target if length <= furthest else root + furthest / length * (target - root)
        length = min(length, furthest)
        move = check(root, aim, margin)
        reached = 1.0 if move.free else move.proven - BACK / max(length, BACK)
        if reached <= 0.0:
            return nearest, False
        count = int(np.ceil(reached * length / STEP)) or 1
        parts = np.linspace(0.0, reached, count + 1)[1:, None]
        self.parents += [nearest, *range(len(self.poses), len(self.poses) + count - 1)]
        self.poses = np.concatenate([self.poses, root + parts * (aim - root)])
        return len(self.poses) - 1, move.free and aim is target

    def branch(self, pose: int) -> list[Array]:
        """Poses from one to the root."""
        branch = [self.poses[pose]]
        while pose:
            pose = self.parents[pose]
            branch.append(self.poses[pose])
        return branch


def _connect(
    check: Check, start: Array, goal: Array, limits: Array, margin: float, rng: np.random.Generator, samples: int
) -> Array | None:
    """RRT-Connect: by turns, one tree extends towards a random pose, the other connects to the pose reached."""
    trees = _Tree(start), _Tree(goal)
    for sample in range(1, samples + 1):
        tree, other = trees if sample % 2 else trees[::-1]
        tip, _ = tree.grow(check, margin, rng.uniform(limits[0], limits[1]), STEP)
        end, met = other.grow(check, margin, tree.poses[tip], np.inf)
        if met:
            branches = [tree.branch(tip), other.branch(end)]
            first, last = branches if sample % 2 else branches[::-1]
            return _without_repeats(np.array([*first[::-1], *last]))
    return None


def _shortened(check: Check, path: Array, margin: float, rng: np.random.Generator) -> Array:
    """Random shortcuts between two points of a path, then removal of waypoints that are not needed."""
    for _ in range(SHORTCUTS):
        at = np.concatenate([[0.0], np.cumsum(_lengths(path))])
        first, other = np.sort(rng.uniform(0.0, at[-1], 2))
        i, j = np.searchsorted(at, first, side="right"), np.searchsorted(at, other, side="left")
        a, b = (np.array([np.interp(length, at, column) for column in path.T]) for length in (first, other))
        if i < j and check(a, b, margin).free:
            path = _without_repeats(np.concatenate([path[:i], [a, b], path[j:]]))
    corner = 1
    while corner < len(path) - 1:
        if check(path[corner - 1], path[corner + 1], margin).free:
            path = np.delete(path, corner, axis=0)
        else:
            corner += 1
    return path


def _lengths(path: Array) -> Array:
    return np.asarray(np.linalg.norm(np.diff(path, axis=0), axis=1))


def _without_repeats(path: Array) -> Array:
    return np.asarray(path[np.concatenate([[True], _lengths(path) > 0.0])])
