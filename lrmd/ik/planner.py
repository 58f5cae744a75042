"""Motion planning with RRT-Connect around obstacles, collision-free for the rigid and for the sagging arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.collision.rrt_connect import Check, NoPath, plan
from lrm_math.collision.scene import Scene, clearance_of
from lrm_math.collision.straight_move import RESOLUTION, MotionClearance, check_move
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.batch_equilibrium import batch_equilibrium
from lrm_math.model.model import Model
from lrmd.config import Config
from lrmd.safety.collision_guard import ClearanceViolation, CollisionGuard, sample_move

SAMPLES = 40
"""Random poses of one attempt: most paths take fewer; a new attempt begins with new trees."""
MARGIN_STEP, MAX_REJECTED = 0.002, 12
"""m: increase of the margin after a path that violates it between the samples; number of such paths to give up."""
WAYS_OUT, FARTHEST_OUT = 200, np.radians(15.0)
"""Random poses tried around an arm that stands within the margin, and how far a joint may turn to them (rad)."""
MERGE = 1e-6
"""Fraction of a move: corners closer together are merged."""


@dataclass(frozen=True)
class JointPath:
    """Waypoints (rad) from the start to the goal, and the number of random `samples` of the search."""

    waypoints: tuple[tuple[float, ...], ...]
    samples: int


@dataclass(eq=False)
class _GoalSearch:
    """Attempts at one goal (rad), with `extra_margin` (m) after `rejected` paths violated the margin."""

    rng: np.random.Generator
    goal: Sequence[float]
    extra_margin: float = 0.0
    rejected: int = 0


@dataclass(frozen=True, eq=False)
class Planner:
    """Plans paths of an arm with a payload (kg) in a collision scene; `model` predicts its sag."""

    config: Config
    scene: Scene
    model: Model
    payload: float

    def find(
        self, start: Sequence[float], goals: Sequence[Sequence[float]], seed: int, check_cancelled: Callable[[], None]
    ) -> JointPath | str:
        """A path from a pose (rad) to one of the goal poses, or the reason why the first goal was given up.

        Tries all goals in turn, repeatedly, until `check_cancelled` raises, which is called before every move that is
        checked. Deterministic for one seed. An arm that stands within the margin, as a new model may say of it, leaves
        it first, by a short move that the guard allows.
        """
        found = self._find_from(start, goals, seed, check_cancelled)
        if isinstance(found, JointPath):
            return found
        clear = self._clear(np.array([start, *goals]))
        if clear[0] or not clear[1:].any():
            return found
        check_cancelled()
        outside = self._way_out(np.array(start), np.random.default_rng([seed, len(goals)]))
        if outside is None:
            return found
        onward = self._find_from(outside.tolist(), goals, seed, check_cancelled)
        if isinstance(onward, str):
            return onward
        first = _with_corners(self.config, np.array([start, outside]))
        return JointPath((*first[:-1], *onward.waypoints), onward.samples)

    def _way_out(self, start: Array, rng: np.random.Generator) -> Array | None:
        """The nearest of some random poses (n,) that is clear and that the guard lets the arm go to."""
        guard = CollisionGuard(self.scene, self.model)
        turns = rng.uniform(-1.0, 1.0, (WAYS_OUT, len(start))) * np.linspace(0.0, FARTHEST_OUT, WAYS_OUT + 1)[1:, None]
        low, high = self.scene.limits
        poses = np.clip(start + turns, low, high)
        for pose in poses[self._clear(poses)]:
            with suppress(ClearanceViolation, NoEquilibrium):
                guard(start.tolist(), pose.tolist(), self.payload)
                return np.asarray(pose)
        return None

    def _clear(self, q: Array) -> NDArray[np.bool_]:
        """(N,), whether the rigid and the loaded arm keep the margin in poses (N, n), and a little more."""
        rigid = clearance_of(self.scene, self.scene.frames(q)).distance
        return (rigid >= self.scene.margin + RESOLUTION) & (self._loaded(q)[0] >= self.scene.margin + RESOLUTION)

    def _find_from(
        self, start: Sequence[float], goals: Sequence[Sequence[float]], seed: int, check_cancelled: Callable[[], None]
    ) -> JointPath | str:

        def check(before: Array, after: Array, margin: float) -> MotionClearance:
            check_cancelled()
            return self._check_move(before, after, margin)

        searches = [_GoalSearch(np.random.default_rng([seed, number]), goal) for number, goal in enumerate(goals)]
        reasons: list[str] = []
        while searches:
            for search in tuple(searches):
                found = self._attempt(start, search, check)
                if isinstance(found, JointPath):
                    return found
                if found is not None:
                    reasons.append(found)
                    searches.remove(search)
        return reasons[0]

    def _attempt(self, start: Sequence[float], search: _GoalSearch, check: Check) -> JointPath | str | None:
        """A path, the reason why there is none, or None to try again."""
        margin = self.scene.margin + search.extra_margin
        found = plan(self.scene, start, search.goal, search.rng, margin=margin, samples=SAMPLES, check=check)
        if isinstance(found, NoPath):
            return self._reason(found, start, search)
        waypoints = _with_corners(self.config, found.waypoints)
        violation = self._violation(waypoints)
        if not violation:
            return JointPath(waypoints, found.samples)
        search.rejected, search.extra_margin = search.rejected + 1, search.extra_margin + MARGIN_STEP
        return f"every path found violates the margin: {violation}" if search.rejected == MAX_REJECTED else None

    def _reason(self, found: NoPath, start: Sequence[float], search: _GoalSearch) -> str | None:
        if search.extra_margin:
            search.extra_margin *= 0.5
            return None
        if found.why != "not found":
            return str(found)
        for what, q in (("start", start), ("goal", search.goal)):
            move = self._check_poses(np.array([q, q]), np.zeros(2), self.scene.margin)
            if not move.free:
                return (
                    f"no path: {what} in collision as the arm sags: {move.first} and {move.second} are "
                    f"{move.distance * 1e3:.1f} mm apart; {move.margin * 1e3:.1f} mm must be kept"
                )
        return None

    def _check_move(self, before: Array, after: Array, margin: float) -> MotionClearance:
        """Proof for the straight move of the rigid arm; if it is free, samples of the sagging arm on it."""
        rigid = check_move(self.scene, before, after, margin)
        if not rigid.free:
            return rigid
        return self._check_poses(*sample_move(before, after), margin)

    def _check_poses(self, q: Array, at: Array, margin: float) -> MotionClearance:
        """Clearance of the loaded arm in poses q (N, n) in rad at fractions `at` (N,) of a move."""
        distance, first, second = self._loaded(q)
        blocked = np.flatnonzero(distance < margin)
        k = int(blocked[0]) if len(blocked) else int(distance.argmin())
        free, closest = not len(blocked), (float(distance[k]), str(first[k]), str(second[k]))
        return MotionClearance(free, *closest, float(at[k]), 1.0 if free else float(at[max(k - 1, 0)]), margin)

    def _loaded(self, q: Array) -> tuple[Array, NDArray[Any], NDArray[Any]]:
        """Smallest distance (N,) of bodies of the loaded arm in poses (N, n), m, and these bodies' names."""
        rest, rows = batch_equilibrium(self.model, poses_of(q, self.payload))
        distance, first, second = np.full(len(q), -np.inf), *np.full((2, len(q)), "an arm not in equilibrium", object)
        if len(rows):
            near = clearance_of(self.scene, frames(self.model.chain, rest.slots, len(rows)))
            distance[rows], first[rows], second[rows] = near.distance, near.first, near.second
        return distance, first, second

    def _violation(self, waypoints: Sequence[tuple[float, ...]]) -> str:
        """First violation found by the daemon's guard or for the loaded arm; empty if the path is free."""
        guard = CollisionGuard(self.scene, self.model)
        try:
            for before, after in pairwise(waypoints):
                guard(before, after, self.payload)
                move = self._check_move(np.array(before), np.array(after), self.scene.margin)
                if not move.free:
                    return str(move)
        except (ClearanceViolation, NoEquilibrium) as error:
            return str(error)
        return ""


def _with_corners(config: Config, path: Array) -> tuple[tuple[float, ...], ...]:
    """The path (M, n) with a waypoint wherever a joint passes a point of its level-1 table."""
    out = [tuple(path[0].tolist())]
    for before, after in pairwise(path):
        at = {1.0}
        for servo, a, b in zip(config.servos, before.tolist(), after.tolist(), strict=False):
            at |= {t for knot in servo.table.angle if a != b and MERGE < (t := (knot - a) / (b - a)) < 1 - MERGE}
        out += [tuple((before + t * (after - before)).tolist()) for t in sorted(at)]
    return tuple(out)
