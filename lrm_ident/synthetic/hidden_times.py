"""Hidden effects that follow the clock: warming up, and what switching off and on again changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .hidden import Effect, EndLoad, JointLoad, at_joint
from .rig import Vector
from .screws import Array


@dataclass(frozen=True)
class WarmUp(Effect):
    """A joint that drifts towards final_rad as it warms up, with one time constant; from the start, not per session."""

    joint: int
    final_rad: float
    constant_s: float

    def added_angles(self, load: JointLoad) -> Array:
        """final * (1 - 2^(-t / half-life))."""
        warmth = 1.0 - np.exp2(-load.now.time_s / (self.constant_s * np.log(2.0)))
        return at_joint(self.joint, self.final_rad * warmth, load.tau_nm)


@dataclass(frozen=True)
class BaseWarmUp(Effect):
    """A base that the warm servos heat: two bodies in a row, so that it starts slowly.

    turn_rad: rotation vector of the base, in its own frame, when all is warm; constants_s: of servos and base.
    """

    turn_rad: Vector
    constants_s: tuple[float, float]

    def bent_links(self) -> tuple[int, ...]:
        """The base."""
        return (0,)

    def link_bend(self, load: EndLoad) -> Array:
        """Step response of two first-order lags in a row with different constants."""
        if load.link != 0:
            return super().link_bend(load)
        (fast, slow), t = self.constants_s, load.now.time_s
        warmth = 1.0 - (slow * np.exp(-t / slow) - fast * np.exp(-t / fast)) / (slow - fast)
        return np.hstack([warmth[:, None] * np.array(self.turn_rad), np.zeros((len(t), 3))])


@dataclass(frozen=True)
class SessionStep(Effect):
    """A joint that stands elsewhere after each power-on: one angle for each session, from the first."""

    joint: int
    steps_rad: tuple[float, ...]

    def added_angles(self, load: JointLoad) -> Array:
        """The step of the pose's session."""
        session = load.now.session.astype(int) - 1
        return at_joint(self.joint, np.array(self.steps_rad)[session], load.tau_nm)
