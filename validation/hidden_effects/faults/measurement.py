"""A healthy measurement, and what a fault leaves of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.reference import EffectRef


class GoesOn(Enum):
    """What of a fault goes on after the measurement that it spoils."""

    NOTHING = "over: rows, files, people, single readings"
    ARM = "the arm stays as it is"
    FRAME = "the tracker errs as at the end; tips are wanted in the frame that it shows"
    LAST_FRAME = "the same of a tracker that was pushed: the frame of its last readings"


NOISE_M = 0.0003  # per axis
BASE = ("session@base", "drift@base", "drift_curve@base", "change_point@base")
"""Names of a base, or a tracker, that moves as a whole."""


def at_joint(joint: int, *effects: str) -> tuple[str, ...]:
    """Names of effects at a joint, which counts from 0."""
    return tuple(str(EffectRef(effect, f"joint{joint + 1}")) for effect in effects)


@dataclass(frozen=True, eq=False)
class HealthyMeasurement:
    """A healthy measurement: commands q (N, n) (rad), load (N,) (kg), positions tcp (N, 3) (m); `at`: positions at
    other commands (N, n)."""

    q: Array
    load: Array
    tcp: Array
    at: Callable[[Array], Array]
    rng: np.random.Generator

    def joint(self) -> int:
        """Draws a joint that carries weight, from 0."""
        return int(self.rng.integers(1, 4))

    def moment(self) -> int:
        """Draws a row in the middle."""
        return int(self.rng.uniform(0.3, 0.7) * len(self.q))

    @property
    def progress(self) -> Array:
        """(N,), from 0 to 1 in the order of measurement."""
        return np.linspace(0.0, 1.0, len(self.q))

    @property
    def weight_moment(self) -> Array:
        """(N,), horizontal distance times weight carried there, over its largest value: what all servos hold."""
        moment = np.linalg.norm(self.tcp[:, :2], axis=1) * (0.2 + self.load)
        return np.asarray(moment / moment.max())

    def moved(self, joint: int, by: Array) -> Array:
        """Positions (N, 3) (m) where one joint stands elsewhere by (N,) (rad)."""
        q = self.q.copy()
        q[:, joint] += by
        return self.at(q)


@dataclass(frozen=True, eq=False)
class SpoiledMeasurement:
    """Positions (N, 3) (m) as a fault leaves them, every pose's session where known, and the names that are right for
    it. q, load: as written in the file, where that is not what was driven."""

    tcp: Array
    session: Array | None = None
    right: tuple[str, ...] = ()
    q: Array | None = None
    load: Array | None = None


Fault = Callable[[HealthyMeasurement], SpoiledMeasurement]
