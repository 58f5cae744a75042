"""Obstacles that clients tell of while the daemon runs: by name, with their owner and their age.

Theory of operation: `cmd/scene` puts and removes them. Only its owner moves or removes one. One that is not told again
in time is dropped. The guard takes them over at once; a motion of which it does not allow the rest is stopped. Nothing
ever moves because of them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from lrm_math.arm.arm import Arm
from lrm_math.arm.collision_shapes import Obstacle
from lrm_math.collision.scene import Scene
from lrmd.config import SECOND
from lrmd.errors import RequestError
from lrmd.messages.control import SceneCommand
from lrmd.messages.surroundings import MOST_CELLS, MOST_OBSTACLES, ObstacleEntry
from lrmd.safety.collision_guard import CollisionGuard, Guard


@dataclass(frozen=True)
class ToldObstacle:
    """An obstacle of an `owner`: told `at` (monotonic ns), to be dropped at `until`, or never."""

    entry: ObstacleEntry
    owner: str
    at: int
    until: int | None


@dataclass(frozen=True)
class KnownObstacles:
    """Obstacles by name."""

    known: Mapping[str, ToldObstacle] = field(default_factory=dict)

    @property
    def entries(self) -> tuple[ObstacleEntry, ...]:
        """Obstacles as they were told."""
        return tuple(obstacle.entry for obstacle in self.known.values())

    def changed(self, command: SceneCommand, reserved: Collection[str], now: int) -> KnownObstacles:
        """After a command. Raises `RequestError`: another owner's, a name of the arm file, or too many."""
        obstacles = dict(self.known)
        for name in (*command.remove, *(entry.name for entry in command.put)):
            if name in reserved:
                raise RequestError("obstacle", f"'{name}' is a shape of the arm file; take another name")
            if name in obstacles and obstacles[name].owner != command.owner:
                raise RequestError("obstacle", f"'{name}' is an obstacle of {obstacles[name].owner}")
        for name in command.remove:
            obstacles.pop(name, None)
        until = None if command.max_age_s is None else now + round(command.max_age_s * SECOND)
        obstacles |= {entry.name: ToldObstacle(entry, command.owner, now, until) for entry in command.put}
        if len(obstacles) > MOST_OBSTACLES:
            raise RequestError("obstacle", f"{len(obstacles)} obstacles; at most {MOST_OBSTACLES} are known at once")
        if (cells := sum(obstacle.entry.cells for obstacle in obstacles.values())) > MOST_CELLS:
            raise RequestError("obstacle", f"{cells} heights; heightfields have at most {MOST_CELLS} in all")
        return KnownObstacles(obstacles)

    def at(self, now: int) -> KnownObstacles:
        """Without those that are too old; the same if none is."""
        fresh = {
            name: obstacle for name, obstacle in self.known.items() if obstacle.until is None or now < obstacle.until
        }
        return self if len(fresh) == len(self.known) else KnownObstacles(fresh)

    def shapes(self) -> tuple[Obstacle, ...]:
        """Their shapes."""
        return tuple(entry.built() for entry in self.entries)

    def added_to(self, guard: Guard | None, arm: Arm) -> Guard | None:
        """A guard of an arm that knows them, too."""
        if not self.known or not isinstance(guard, CollisionGuard):
            return guard
        return replace(guard, scene=Scene.of(arm, around=self.shapes()))
