"""Ways round obstacles that keep the arm clear as a rigid one and as it sags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lrm_math.arrays import Array
from lrm_math.collision.rrt_connect import NoPath, plan
from lrm_math.collision.scene import Scene, clearance_of
from lrm_math.collision.straight_move import Move, check_move
from lrm_math.errors import NotSettled
from lrm_math.ik.batch_equilibrium import settled
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.model import Model
from lrmd.config import Config
from lrmd.safety.collision_guard import Safety, TooClose

SAMPLES = 40
"""Random poses of one attempt: most ways take fewer; a new attempt begins with new trees."""
MORE_MARGIN, TOO_NARROW = 0.002, 12
"""m: how much more distance is kept after a way that is too narrow between the poses looked at; how many such ways it
takes to give up."""
SAME = 1e-6
"""Share of a move: corners that are no further apart than this are one."""
LOOK_EVERY = 0.05
"""rad: how densely the loaded arm is looked at."""


@dataclass(frozen=True)
class Way:
    """Waypoints (rad) from the start to the end."""

    waypoints: tuple[tuple[float, ...], ...]
    samples: int


@dataclass(eq=False)
class _Course:
    """Attempts at one end: how much more than the margin is kept (m), because so many ways were too narrow."""

    rng: np.random.Generator
    end: Sequence[float]
    more: float = 0.0
    narrow: int = 0


@dataclass(frozen=True, eq=False)
class Planner:
    """An arm among its obstacles, the model that says how it sags, and its load (kg)."""

    config: Config
    scene: Scene
    model: Model
    payload: float

    def find(
        self, start: Sequence[float], ends: Sequence[Sequence[float]], seed: int, goes_on: Callable[[], None]
    ) -> Way | str:
        """A way from a pose (rad) to one of others, or why the first of them was given up.

        All are tried in turn, again and again, until `goes_on` raises. The same seed tries the same ways.
        """
        courses = [_Course(np.random.default_rng([seed, number]), end) for number, end in enumerate(ends)]
        reasons: list[str] = []
        while courses:
            for course in tuple(courses):
                goes_on()
                found = self._attempt(start, course)
                if isinstance(found, Way):
                    return found
                if found is not None:
                    reasons.append(found)
                    courses.remove(course)
        return reasons[0]

    def _attempt(self, start: Sequence[float], course: _Course) -> Way | str | None:
        """A way, why there can be none, or None if it is worth trying again."""
        margin = self.scene.margin + course.more
        found = plan(self.scene, start, course.end, course.rng, margin=margin, samples=SAMPLES, check=self._check)
        if isinstance(found, NoPath):
            return self._why_not(found, start, course)
        waypoints = _with_corners(self.config, found.waypoints)
        narrow = self._too_narrow(waypoints)
        if not narrow:
            return Way(waypoints, found.samples)
        course.narrow, course.more = course.narrow + 1, course.more + MORE_MARGIN
        return f"every way that was found is too narrow: {narrow}" if course.narrow == TOO_NARROW else None

    def _why_not(self, found: NoPath, start: Sequence[float], course: _Course) -> str | None:
        if course.more:
            course.more *= 0.5
            return None
        if found.why != "not found":
            return str(found)
        for what, q in (("start", start), ("goal", course.end)):
            move = self._sagging(np.array([q, q]), np.zeros(2), self.scene.margin)
            if not move.free:
                return (
                    f"no path: {what} in collision as the arm sags: {move.first} and {move.second} are "
                    f"{move.distance * 1e3:.1f} mm apart; {move.margin * 1e3:.1f} mm must be kept"
                )
        return None

    def _check(self, before: Array, after: Array, margin: float) -> Move:
        """The straight move of the rigid arm, which is proven; if it is free, that of the one that sags, looked at."""
        rigid = check_move(self.scene, before, after, margin)
        if not rigid.free:
            return rigid
        at = np.linspace(0.0, 1.0, 2 + int(np.abs(after - before).max() / LOOK_EVERY))
        return self._sagging(before + at[:, None] * (after - before), at, margin)

    def _sagging(self, q: Array, at: Array, margin: float) -> Move:
        """What is known of poses q (N, n) in rad of the loaded arm, which stand at shares `at` (N,) of a move."""
        rest, rows = settled(self.model, poses_of(q, self.payload))
        distance, first, second = np.full(len(q), -np.inf), *np.full((2, len(q)), "an arm without a rest", dtype=object)
        if len(rows):
            near = clearance_of(self.scene, frames(self.model.chain, rest.slots, len(rows)))
            distance[rows], first[rows], second[rows] = near.distance, near.first, near.second
        blocked = np.flatnonzero(distance < margin)
        k = int(blocked[0]) if len(blocked) else int(distance.argmin())
        proven = 1.0 if not len(blocked) else float(at[max(k - 1, 0)])
        return Move(not len(blocked), float(distance[k]), str(first[k]), str(second[k]), float(at[k]), proven, margin)

    def _too_narrow(self, waypoints: Sequence[tuple[float, ...]]) -> str:
        """What the daemon's own check of every move, or that of the loaded arm, has against the way; else nothing."""
        check = Safety(self.scene, self.model)
        try:
            for before, after in pairwise(waypoints):
                check(before, after)
                move = self._check(np.array(before), np.array(after), self.scene.margin)
                if not move.free:
                    return str(move)
        except (TooClose, NotSettled) as error:
            return str(error)
        return ""


def _with_corners(config: Config, way: Array) -> tuple[tuple[float, ...], ...]:
    """The way with a waypoint wherever a joint passes a point of its level-1 table."""
    out = [tuple(way[0].tolist())]
    for before, after in pairwise(way):
        at = {1.0}
        for servo, a, b in zip(config.servos, before.tolist(), after.tolist(), strict=False):
            at |= {t for knot in servo.table.angle if a != b and SAME < (t := (knot - a) / (b - a)) < 1 - SAME}
        out += [tuple((before + t * (after - before)).tolist()) for t in sorted(at)]
    return tuple(out)
