"""Which straight moves are safe: those on which neither the rigid nor the sagging arm comes too close to anything."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.collision.scene import Scene, clearance_of
from lrm_math.collision.straight_move import check_move
from lrm_math.errors import LrmError
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model

Guard = Callable[[Sequence[float], Sequence[float]], None]
"""Raises an `LrmError` if the straight way between two poses (rad, one angle per joint) is not safe."""
LOOK_EVERY = 0.05
"""rad: how densely the sagging arm is looked at along a move; about 3 degrees."""
SLACK = 1e-3
"""m: an arm that stands too close may move as long as it comes closer by no more than this."""


class TooClose(LrmError):
    """A move that is not safe; carries the bodies `first` and `second`, their `distance` (m) and where: `fraction`."""

    def __init__(self, first: str, second: str, distance: float, fraction: float, margin: float) -> None:
        self.first, self.second, self.distance, self.fraction = first, second, distance, fraction
        super().__init__(
            f"{first} and {second} would come to {distance * 1e3:.0f} mm of each other at {fraction:.0%} of the way; "
            f"{margin * 1e3:.0f} mm must be kept"
        )


@dataclass(frozen=True)
class Safety:
    """The shapes of an arm and, where it is known, the model that says how it sags."""

    scene: Scene
    model: Model | None

    def __call__(self, here: Sequence[float], there: Sequence[float]) -> None:
        """Raises `TooClose` for a move that comes within the margin.

        An arm that already stands within it may leave: then the margin is the distance it has now.
        """
        margin = max(0.0, min(self.scene.margin, self.scene.closest(here).distance - SLACK))
        rigid = check_move(self.scene, here, there, margin)
        if not rigid.free:
            raise TooClose(rigid.first, rigid.second, rigid.distance, rigid.fraction, margin)
        if self.model is not None:
            self._check_sagging(self.model, here, there)

    def _check_sagging(self, model: Model, here: Sequence[float], there: Sequence[float]) -> None:
        start, way = np.array(here), np.array(there) - np.array(here)
        at = np.linspace(0.0, 1.0, 2 + int(np.abs(way).max() / LOOK_EVERY))
        rest = equilibrium(model, poses_of(start + at[:, None] * way, 0.0))
        near = clearance_of(self.scene, frames(model.chain, rest.slots, len(at)))
        margin = min(self.scene.margin, float(near.distance[0]) - SLACK)
        worst = int(np.argmin(near.distance))
        if near.distance[worst] < margin:
            pair = str(near.first[worst]), str(near.second[worst])
            raise TooClose(*pair, float(near.distance[worst]), float(at[worst]), margin)


def guard_of(arm: Arm, model: Model | None) -> Guard | None:
    """The guard of an arm, or None if its file has no shapes: then nobody can tell."""
    if not arm.shapes.capsules:
        return None
    return Safety(Scene.of(arm), model)
