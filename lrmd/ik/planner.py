"""Motion planning with RRT-Connect around obstacles, collision-free for the rigid and for the sagging arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from lrm_math.arrays import Array
from lrm_math.collision.rrt_connect import Check, NoPath, plan
from lrm_math.collision.scene import Scene
from lrm_math.collision.straight_move import RESOLUTION, MotionClearance
from lrm_math.ik.calibrated_arm import CancellationCheck
from lrmd.config import Config
from lrmd.safety.collision_guard import CollisionGuard

SAMPLES = 40
"""Random poses of one attempt: most paths take fewer; a new attempt begins with new trees."""
MARGIN_STEP, MAX_REJECTED = 0.002, 12
"""m: increase of the margin after a path that violates it between the samples; number of such paths to give up."""
ROUNDS_OUT, POSES_OUT, CHECKS_OUT = 40, 150, 20
"""Limits of the search for a way out of the margin: rounds, random poses in each, moves checked to those not clear."""
MERGE = 1e-6
"""Fraction of a move: corners closer together are merged."""


JointPath: TypeAlias = tuple[tuple[float, ...], ...]
"""Waypoints (rad) from the start to the goal."""


@dataclass(frozen=True)
class NoPlan:
    """No path to a goal, and why."""

    text: str


@dataclass(eq=False)
class _GoalSearch:
    """Attempts at one goal (rad), with `extra_margin` (m) after `rejected` paths violated the margin."""

    rng: np.random.Generator
    goal: Sequence[float]
    extra_margin: float = 0.0
    rejected: int = 0


@dataclass(frozen=True, eq=False)
class Planner:
    """Plans paths of an arm with a payload (kg) that its collision guard allows, piece by piece."""

    config: Config
    guard: CollisionGuard
    payload: float

    @property
    def scene(self) -> Scene:
        """The collision scene of the guard."""
        return self.guard.scene

    def find(
        self, start: Sequence[float], goals: Sequence[Sequence[float]], seed: int, check_cancelled: CancellationCheck
    ) -> JointPath | NoPlan:
        """A path from a pose (rad) to one of the goal poses, or the reason why the first goal was given up.

        Tries all goals in turn, repeatedly, until `check_cancelled` raises, which is called before every move that is
        checked. Deterministic for one seed. An arm that stands within the margin, or in overlap, leaves it first, by
        moves that the guard allows.
        """
        if self.guard.stability is not None:
            steady = self.guard.stability.steady(np.array(start), np.array(goals), self.payload)
            goals = [goal for goal, good in zip(goals, steady, strict=True) if good]
            if not goals:
                return NoPlan("no path: the vehicle would be too near to tipping over at the goal")
        path_found = self._find_from(start, goals, seed, check_cancelled)
        if not isinstance(path_found, NoPlan):
            return path_found
        apart = self.guard.separation(np.array([start, *goals]), self.payload)
        clear = apart >= self.scene.margin + RESOLUTION  # both the rigid and the loaded arm
        if clear[0] or not clear[1:].any():
            return path_found
        direct = (self.allowed((tuple(start),), goal) for goal in goals)
        if (straight := next(filter(None, direct), None)) is not None:
            return straight
        way = self.way_out(start, np.random.default_rng([seed, len(goals)]), check_cancelled)
        if way is None:
            return path_found
        onward = self._find_from(way[-1], goals, seed, check_cancelled)
        return onward if isinstance(onward, NoPlan) else (*way[:-1], *onward)

    def allowed(self, way: JointPath, goal: Sequence[float]) -> JointPath | None:
        """A way that the guard allows with a straight move to a goal (n,) after it, rad; None if it refuses the whole.

        With its corners, as it is passed on: the guard may refuse a part of a straight move that it allows, where this
        keeps what is required by less than `RESOLUTION`.
        """
        path = (*way[:-1], *with_corners(self.config, np.array([way[-1], goal])))
        return path if self.guard.check(np.array(path), self.payload)[0].free else None

    def way_out(
        self, start: Sequence[float], rng: np.random.Generator, check_cancelled: CancellationCheck
    ) -> JointPath | None:
        """A way from the start (n,) to a clear pose that the guard allows, or None if none was found.

        A tree of ways: of random poses around the end of one the nearest clear one ends the search, else the one with
        the largest separation makes another way of the tree. Each way is checked whole, so its later moves may come as
        near as the arm stands at the start.
        """
        ways: list[JointPath] = [(tuple(start),)]
        for _ in range(ROUNDS_OUT):
            path_found, clear = self._outward(ways[int(rng.integers(len(ways)))], rng, check_cancelled)
            if clear:
                return path_found
            if path_found is not None:
                ways.append(path_found)
        return None

    def _outward(
        self, way: JointPath, rng: np.random.Generator, check_cancelled: CancellationCheck
    ) -> tuple[JointPath | None, bool]:
        """A longer way that the guard allows to a pose with more room than the start; whether that is clear."""
        (low, high), here = self.scene.limits, np.array(way[-1])
        turns = rng.uniform(-1.0, 1.0, (POSES_OUT, len(here))) * (rng.random((POSES_OUT, len(here))) < 0.7)
        poses = np.clip(here + turns * np.linspace(0.0, 1.0, POSES_OUT + 1)[1:, None] ** 2 * (high - low), low, high)
        apart = self.guard.separation(np.array([way[0], *poses]), self.payload)
        clear, gain = apart[1:] >= self.scene.margin + RESOLUTION, apart[1:] - apart[0]
        by_gain = [int(k) for k in np.argsort(-gain)[:CHECKS_OUT] if gain[k] > RESOLUTION and not clear[k]]
        for k in [*np.flatnonzero(clear), *by_gain]:
            check_cancelled()
            if (longer := self.allowed(way, poses[k].tolist())) is not None:
                return longer, bool(clear[k])
        return None, False

    def _find_from(
        self, start: Sequence[float], goals: Sequence[Sequence[float]], seed: int, check_cancelled: CancellationCheck
    ) -> JointPath | NoPlan:

        def check(before: Array, after: Array, margin: float) -> MotionClearance:
            check_cancelled()
            return self.guard.check(np.array([before, after]), self.payload, margin)[0]

        searches = [_GoalSearch(np.random.default_rng([seed, number]), goal) for number, goal in enumerate(goals)]
        reasons: list[NoPlan] = []
        while searches:
            for search in tuple(searches):
                path_found = self._attempt(start, search, check)
                if isinstance(path_found, NoPlan):
                    reasons.append(path_found)
                    searches.remove(search)
                elif path_found is not None:
                    return path_found
        return reasons[0]

    def _attempt(self, start: Sequence[float], search: _GoalSearch, check: Check) -> JointPath | NoPlan | None:
        """A path, the reason why there is none, or None to try again."""
        margin = self.scene.margin + search.extra_margin
        path_found = plan(self.scene, start, search.goal, search.rng, margin, SAMPLES, check)
        if isinstance(path_found, NoPath):
            return self._reason(path_found, start, search)
        waypoints = with_corners(self.config, path_found)
        violation = self._violation(waypoints)
        if not violation:
            return waypoints
        search.rejected, search.extra_margin = search.rejected + 1, search.extra_margin + MARGIN_STEP
        given_up = search.rejected == MAX_REJECTED
        return NoPlan(f"every path found violates the margin: {violation}") if given_up else None

    def _reason(self, no_path: NoPath, start: Sequence[float], search: _GoalSearch) -> NoPlan | None:
        if search.extra_margin:
            search.extra_margin *= 0.5
            return None
        if no_path.why != "not found":
            return NoPlan(str(no_path))
        for what, q in (("start", np.array(start)), ("goal", np.array(search.goal))):
            move, _ = self.guard.check(np.array([q, q]), self.payload, self.scene.margin)
            if not move.free:
                return NoPlan(
                    f"no path: {what} in collision as the arm sags: {move.first} and {move.second} are "
                    f"{move.distance * 1e3:.1f} mm apart; {move.margin * 1e3:.1f} mm must be kept"
                )
        return None

    def _violation(self, waypoints: Sequence[tuple[float, ...]]) -> str:
        """The first piece that the guard refuses, as text; empty if the path is free."""
        move, _ = self.guard.check(np.array(waypoints), self.payload, self.scene.margin)
        return "" if move.free else str(move)


def with_corners(config: Config, path: Array) -> JointPath:
    """The path (M, n) with a waypoint wherever a joint passes a point of its level-1 table."""
    out = [tuple(path[0].tolist())]
    for before, after in pairwise(path):
        at = {1.0}
        for servo, a, b in zip(config.servos, before.tolist(), after.tolist(), strict=False):
            at |= {t for knot in servo.table.angle if a != b and MERGE < (t := (knot - a) / (b - a)) < 1 - MERGE}
        out += [tuple((before + t * (after - before)).tolist()) for t in sorted(at)]
    return tuple(out)
