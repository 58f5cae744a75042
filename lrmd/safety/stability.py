"""Does a motion bring the vehicle that the arm stands on too near to tipping over? Asked only if configured.

Rule: on its way the tip-over angle stays above what is to be kept or, for a vehicle that is nearer to tipping already,
above that of the start. The angle is that of the sagging arm with its payload, under the direction of gravity in use,
and counts no acceleration. It is looked at every `STEP`: between two such poses it is assumed to be no smaller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.vehicle import Vehicle
from lrm_math.arrays import Array
from lrm_math.collision.straight_move import MotionClearance
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.tip_over import tip_over_angles
from lrmd.config import Config

STEP = 0.02
"""rad, about 1 degree: largest joint step between two poses that are looked at."""
ROUND_OFF = 1e-9
"""rad."""


@dataclass(frozen=True)
class TippingMove(MotionClearance):
    """A move on which the vehicle comes too near to tipping over; `distance` and `margin` are angles (rad)."""

    def __str__(self) -> str:
        here, kept = math.degrees(self.distance), math.degrees(self.margin)
        what = "would tip over" if here < 0.0 else f"would be {here:.1f} deg from tipping over"
        return f"the vehicle {what} at {self.fraction:.0%} of the way; {kept:.1f} deg must be kept"


class TipOverViolation(LrmError):
    """A way on which the vehicle comes to an `angle` (rad) at `fraction` (0 to 1) of move number `move`."""

    def __init__(self, found: TippingMove, move: int) -> None:
        self.move, self.angle, self.fraction = move, found.distance, found.fraction
        super().__init__(str(found))


@dataclass(frozen=True, eq=False)
class Stability:
    """The `vehicle` of an arm, the tip-over angle to `keep` (rad), and the `model` by which the arm sags."""

    vehicle: Vehicle
    keep: float
    model: Model

    def angles(self, q: Array, payload: float) -> Array:
        """(N,), tip-over angles (rad) in poses (N, n) with a payload (kg); -pi where the arm has no equilibrium."""
        settled, rows = batch_equilibrium(self.model, poses_of(q, payload))
        out = np.full(len(q), -np.pi)
        if len(rows):
            out[rows] = tip_over_angles(settled, payload, self.vehicle, self.model.constant_gravity)
        return out

    def refused(self, path: Array, payload: float) -> tuple[TippingMove, int] | None:
        """Where the rule is broken first on straight moves through poses (K, n), and the number of the move, from 0."""
        travel = np.diff(path, axis=0)
        counts = np.ceil(np.abs(travel).max(axis=1, initial=0.0) / STEP).astype(np.intp) + 1
        parts = [move + np.arange(count) / count for move, count in enumerate(counts.tolist())]
        at = np.concatenate([*parts, [float(len(travel))]])
        move = np.minimum(at.astype(np.intp), len(travel) - 1)
        angles = self.angles(path[move] + (at - move)[:, None] * travel[move], payload)
        required = min(self.keep, float(angles[0]))
        below = np.flatnonzero(angles < required - ROUND_OFF)
        if not len(below):
            return None
        k = int(below[0])
        number = int(move[k - 1])
        share, proven = float(at[k] - number), float(at[k - 1] - number)
        return TippingMove(False, float(angles[k]), "vehicle", "ground", share, proven, required), number

    def steady(self, start: Array, goals: Array, payload: float) -> NDArray[np.bool_]:
        """(K,), whether the rule allows to end in poses (K, n) a way that begins at one (n,)."""
        angles = self.angles(np.array([start, *goals]), payload)
        return np.asarray(angles[1:] >= min(self.keep, float(angles[0])) - ROUND_OFF)


def stability_of(config: Config, model: Model) -> Stability | None:
    """The rule that a configuration sets, by a model; None: it sets none."""
    if config.tip_over is None or config.arm.vehicle is None:
        return None
    return Stability(config.arm.vehicle, config.tip_over, model)
