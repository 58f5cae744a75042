"""Collision guard: a straight move is safe if the rigid and the sagging arm keep the safety margin all along it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene, clearance_of
from lrm_math.collision.straight_move import check_move
from lrm_math.errors import LrmError
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model

Guard = Callable[[Sequence[float], Sequence[float], float], None]
"""Raises an `LrmError` if the straight move between two poses (rad, per joint) with a payload (kg) is not safe."""
SAMPLING_STEP = 0.05
"""rad, about 3 degrees: largest joint step between the sampled poses of the sagging arm."""
SLACK = 1e-3
"""m: an arm within the margin may come closer by no more than this while it moves."""


class ClearanceViolation(LrmError):
    """An unsafe move: bodies `first` and `second` are at `distance` (m) at `fraction` (0 to 1) of the move."""

    def __init__(self, first: str, second: str, distance: float, fraction: float, margin: float) -> None:
        self.first, self.second, self.distance, self.fraction = first, second, distance, fraction
        super().__init__(
            f"{first} and {second} would come to {distance * 1e3:.0f} mm of each other at {fraction:.0%} of the way; "
            f"{margin * 1e3:.0f} mm must be kept"
        )


@dataclass(frozen=True)
class CollisionGuard:
    """The `Guard` of an arm's collision `scene`; `model` predicts its sag, None for an uncalibrated arm."""

    scene: Scene
    model: Model | None

    def __call__(self, here: Sequence[float], there: Sequence[float], payload: float) -> None:
        """Raises `ClearanceViolation` for a move with a payload (kg) that comes within the margin.

        An arm that starts within it may leave: then the margin is its present distance.
        """
        margin = max(0.0, min(self.scene.margin, self.scene.closest(here).distance - SLACK))
        rigid = check_move(self.scene, here, there, margin)
        if not rigid.free:
            raise ClearanceViolation(rigid.first, rigid.second, rigid.distance, rigid.fraction, margin)
        if self.model is not None:
            self._check_sagging(self.model, here, there, payload)

    def _check_sagging(self, model: Model, here: Sequence[float], there: Sequence[float], payload: float) -> None:
        q, at = sample_move(np.array(here), np.array(there))
        rest = equilibrium(model, poses_of(q, payload))
        near = clearance_of(self.scene, frames(model.chain, rest.slots, len(at)))
        margin = min(self.scene.margin, float(near.distance[0]) - SLACK)
        worst = int(np.argmin(near.distance))
        if near.distance[worst] < margin:
            pair = str(near.first[worst]), str(near.second[worst])
            raise ClearanceViolation(*pair, float(near.distance[worst]), float(at[worst]), margin)


def sample_move(start: Array, end: Array) -> tuple[Array, Array]:
    """Poses (N, n) on the straight move between two poses (n,) in rad, and their fractions (N,) of it."""
    at = np.linspace(0.0, 1.0, 2 + int(np.abs(end - start).max() / SAMPLING_STEP))
    return start + at[:, None] * (end - start), at


def guard_of(arm: Arm, model: Model | None) -> Guard | None:
    """The guard of an arm, or None if its file has no collision shapes."""
    return CollisionGuard(Scene.of(arm), model) if arm.shapes.capsules else None
