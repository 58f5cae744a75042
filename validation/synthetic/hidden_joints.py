"""Hidden effects of joints: gear, servo, spring, cable, drift. Joints count from 1; angles in rad, torques in Nm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .hidden_effect import HiddenEffect, JointLoad, at_joint
from .screws import Array


@dataclass(frozen=True)
class SoftPlay(HiddenEffect):
    """Smoothed backlash: half the width times tau / sqrt(tau^2 + softness^2)."""

    joint: int
    width_rad: float
    softness_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        tau = load.tau_nm[:, self.joint - 1]
        return at_joint(self.joint, 0.5 * self.width_rad * tau / np.hypot(tau, self.softness_nm), load.tau_nm)


@dataclass(frozen=True)
class HardeningSpring(HiddenEffect):
    """Hardening torsional stiffness: the linear spring becomes size * asinh(tau / scale) for large torques.

    size / scale must stay below the joint's linear compliance, else the total compliance becomes negative.
    """

    joint: int
    size_rad: float
    scale_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        x = load.tau_nm[:, self.joint - 1] / self.scale_nm
        return at_joint(self.joint, self.size_rad * (np.arcsinh(x) - x), load.tau_nm)


@dataclass(frozen=True)
class OneSidedGain(HiddenEffect):
    """Gain error of a servo on one side (+1 or -1) of zero only, with a hyperbolic corner at zero."""

    joint: int
    side: int
    gain: float
    corner_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        q = self.side * load.poses.q_rad[:, self.joint - 1]
        ramp = 0.5 * (q + np.hypot(q, self.corner_rad) - self.corner_rad)
        return at_joint(self.joint, self.side * self.gain * ramp, load.tau_nm)


@dataclass(frozen=True)
class FastClock(HiddenEffect):
    """A servo board whose clock is off by a part: all pulses, that of the middle angle included, are too long by it.

    middle_rad: the angle that the pulse of zero would turn a servo by if it began at no pulse.
    """

    part: float
    middle_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        return np.asarray(self.part * (load.poses.q_rad + self.middle_rad))


@dataclass(frozen=True)
class EccentricShaft(HiddenEffect):
    """Eccentricity of an angle sensor or servo horn.

    offset: eccentricity over the radius at which the angle is taken; phase_rad: its direction.
    """

    joint: int
    offset: float
    phase_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        """Angle about the eccentric centre less the true angle; zero at angle zero."""
        q = load.poses.q_rad[:, self.joint - 1]
        return at_joint(self.joint, self._error(q) - self._error(np.zeros_like(q)), load.tau_nm)

    def _error(self, q: Array) -> Array:
        y, x = (f(q) - self.offset * f(self.phase_rad) for f in (np.sin, np.cos))
        return np.asarray(np.arctan2(y * np.cos(q) - x * np.sin(q), x * np.cos(q) + y * np.sin(q)))


@dataclass(frozen=True)
class FrictionLag(HiddenEffect):
    """Friction hysteresis: the joint lags behind its move; reversal is gradual (Dahl 1968, in position, not force).

    width_rad: of the loop; negative if the joint overshoots. travel_rad: the move after which 1 - 1/e of a reversal is
    done. Poses are in measured order.
    """

    joint: int
    width_rad: float
    travel_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        """Minus half the width times the Dahl state from -1 to 1, which each move draws towards its direction."""
        q, side = load.poses.q_rad[:, self.joint - 1], load.poses.direction[:, self.joint - 1]
        state = side.copy()  # a long move precedes the first pose
        for row in range(1, len(q)):
            left = np.exp(-abs(q[row] - q[row - 1]) / self.travel_rad)
            state[row] = side[row] + (state[row - 1] - side[row]) * left
        return at_joint(self.joint, -0.5 * self.width_rad * state, load.tau_nm)


@dataclass(frozen=True)
class CablePull(HiddenEffect):
    """Restoring torque of a cable bundle that is slack up to an angle and stiffens exponentially beyond.

    side: +1 if it tightens above slack_rad, -1 if below. stiffening_rad: angle over which its stiffness grows e-fold.
    """

    joint: int
    side: int
    slack_rad: float
    stiffness_nm_per_rad: float
    stiffening_rad: float

    def added_torques(self, load: JointLoad) -> Array:
        """Torque -stiffness * s * (exp(x / s) - 1) at excess x; it acts through the joint's compliance."""
        excess = np.maximum(0.0, self.side * (load.poses.q_rad[:, self.joint - 1] - self.slack_rad))
        pull = self.stiffness_nm_per_rad * self.stiffening_rad * np.expm1(excess / self.stiffening_rad)
        return at_joint(self.joint, -self.side * pull, load.tau_nm)


@dataclass(frozen=True)
class CoupledJoint(HiddenEffect):
    """Coupling of a joint to the angle of another one: ratio * bend * sin(q / bend), of slope `ratio` at zero."""

    joint: int
    by: int
    ratio: float
    bend: float

    def added_angles(self, load: JointLoad) -> Array:
        q = load.poses.q_rad[:, self.by - 1]
        return at_joint(self.joint, self.ratio * self.bend * np.sin(q / self.bend), load.tau_nm)


@dataclass(frozen=True)
class EntangledJoint(HiddenEffect):
    """Interaction of two other joints' angles, which is in no catalogue.

    form: "sum" for sin(q_a + q_b), "product" for sin(q_a) sin(q_b), "beat" for sin(2 q_a) cos(q_b).
    """

    joint: int
    by: tuple[int, int]
    size_rad: float
    form: Literal["sum", "product", "beat"]

    def added_angles(self, load: JointLoad) -> Array:
        a, b = (load.poses.q_rad[:, joint - 1] for joint in self.by)
        shapes = {"sum": np.sin(a + b), "product": np.sin(a) * np.sin(b), "beat": np.sin(2.0 * a) * np.cos(b)}
        return at_joint(self.joint, self.size_rad * shapes[self.form], load.tau_nm)


@dataclass(frozen=True)
class WarmUp(HiddenEffect):
    """First-order warm-up drift of a joint towards final_rad; the clock does not restart with a session."""

    joint: int
    final_rad: float
    constant_s: float

    def added_angles(self, load: JointLoad) -> Array:
        warmth = 1.0 - np.exp2(-load.poses.time_s / (self.constant_s * np.log(2.0)))
        return at_joint(self.joint, self.final_rad * warmth, load.tau_nm)


@dataclass(frozen=True)
class JointSlip(HiddenEffect):
    """A joint that stands elsewhere from one moment on: a belt that skips a tooth, a horn that slips."""

    joint: int
    size_rad: float
    since_s: float

    def added_angles(self, load: JointLoad) -> Array:
        return at_joint(self.joint, np.where(load.poses.time_s >= self.since_s, self.size_rad, 0.0), load.tau_nm)


@dataclass(frozen=True)
class SessionStep(HiddenEffect):
    """Zero offset of a joint that changes at power-on: one angle per session."""

    joint: int
    steps_rad: tuple[float, ...]

    def added_angles(self, load: JointLoad) -> Array:
        session = load.poses.session.astype(int) - 1
        return at_joint(self.joint, np.array(self.steps_rad)[session], load.tau_nm)
