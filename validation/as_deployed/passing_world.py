"""Worlds of the loop: as they are while measuring, afterwards, and with all causes known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lrm_math.arrays import Array
from validation.as_deployed.leaning import Lean
from validation.synthetic import (
    ArmDescription,
    GroundTruth,
    JointSlip,
    WarmUp,
    base_displacement_to_deviations,
    load_arm,
)
from validation.synthetic.example import ARM_FILE
from validation.synthetic.screws import rotation_matrix

DRIFT_DEG, WARMS_S = (0.5, 1.0), 80.0
TILT_DEG = 4
PUSH_M, PUSH_DEG, PUSHED_AT_S = 0.003, 0.3, 240.0


@dataclass(frozen=True)
class PassingWorld:
    """Arm of a seed with random errors, whose joint 2, 3 or 4 drifts, on a base that leans, seen by a tracker.

    The tracker's base target is pushed while measuring.
    """

    seed: int

    @cached_property
    def _drawn(self) -> np.random.Generator:
        return np.random.default_rng([self.seed, 56])

    @cached_property
    def _sizes(self) -> tuple[int, float, int, Array, Array]:
        rng = self._drawn
        joint, drift = int(rng.integers(2, 5)), math.radians(rng.uniform(*DRIFT_DEG)) * rng.choice([-1, 1])
        tilt = TILT_DEG * int(rng.choice([-1, 1]))
        turn = np.radians(rng.uniform(-PUSH_DEG, PUSH_DEG, 3))
        return joint, float(drift), tilt, turn, rng.uniform(-PUSH_M, PUSH_M, 3)

    @property
    def hidden(self) -> str:
        """The causes."""
        joint, drift, tilt, *_ = self._sizes
        return f"drift@joint{joint} {math.degrees(drift):.1f}°, pushed base target, gravity {tilt}° about {self._axis}"

    @property
    def passing(self) -> tuple[ArmDescription, GroundTruth]:
        """The arm as it is measured, leaning and warming up."""
        joint, drift, *_ = self._sizes
        return self._leaning, self._truth(WarmUp(joint, drift, WARMS_S))

    @property
    def lasting(self) -> tuple[ArmDescription, GroundTruth]:
        """The arm as it goes on: leaning and warm."""
        return self._leaning, self._truth(self._warm)

    @property
    def level(self) -> tuple[ArmDescription, GroundTruth]:
        """The warm arm on a level base."""
        return load_arm(ARM_FILE), self._truth(self._warm)

    def pushed(self, tips_m: Array) -> Array:
        """(N, 3), tips (m) as seen beside the base target, after it was pushed."""
        *_, turn, shift = self._sizes
        return np.asarray(tips_m @ rotation_matrix(tuple(turn)).T + shift)

    @property
    def _axis(self) -> str:
        return "xy"[self.seed % 2]

    @property
    def _leaning(self) -> ArmDescription:
        return load_arm(ARM_FILE).tilted(Lean(self._axis, self._sizes[2], 0).turn_rad)

    @property
    def _warm(self) -> JointSlip:
        joint, drift, *_ = self._sizes
        return JointSlip(joint, drift, -math.inf)

    def _truth(self, effect: WarmUp | JointSlip) -> GroundTruth:
        arm = load_arm(ARM_FILE)
        return base_displacement_to_deviations(arm, GroundTruth.random(arm, self.seed, (effect,)))
