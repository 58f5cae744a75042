"""Hidden effects in the joints: gears, servos, springs, cables. Joints count from 1; angles in rad, torques in Nm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .hidden import Effect, JointLoad, at_joint
from .screws import Array


@dataclass(frozen=True)
class SoftPlay(Effect):
    """Play that a torque takes up gradually: half the width times tau / sqrt(tau^2 + softness^2)."""

    joint: int
    width_rad: float
    softness_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        """The joint lies towards the side to which the torque pushes it."""
        tau = load.tau_nm[:, self.joint - 1]
        return at_joint(self.joint, 0.5 * self.width_rad * tau / np.hypot(tau, self.softness_nm), load.tau_nm)


@dataclass(frozen=True)
class HardeningSpring(Effect):
    """A joint that gets stiffer under torque: the linear spring becomes size * asinh(tau / scale) for large torques.

    size / scale has to stay below the joint's linear compliance, or the joint would turn against large torques.
    """

    joint: int
    size_rad: float
    scale_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        """What the asinh falls short of its own slope at zero: size * (asinh(tau / scale) - tau / scale)."""
        x = load.tau_nm[:, self.joint - 1] / self.scale_nm
        return at_joint(self.joint, self.size_rad * (np.arcsinh(x) - x), load.tau_nm)


@dataclass(frozen=True)
class OneSidedGain(Effect):
    """A servo that turns too far by a share of the angle on one side (+1 or -1) only, with a rounded corner at zero."""

    joint: int
    side: int
    gain: float
    corner_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        """A hyperbola between zero and gain * q."""
        q = self.side * load.now.q_rad[:, self.joint - 1]
        ramp = 0.5 * (q + np.hypot(q, self.corner_rad) - self.corner_rad)
        return at_joint(self.joint, self.side * self.gain * ramp, load.tau_nm)


@dataclass(frozen=True)
class EccentricShaft(Effect):
    """An angle sensor or horn whose centre lies beside the axis.

    offset: distance of the centres over the radius at which the angle is taken; phase_rad: where the centre lies.
    """

    joint: int
    offset: float
    phase_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        """The angle of a point of the circle seen from the other centre, less the true one; zero at angle zero."""
        q = load.now.q_rad[:, self.joint - 1]
        return at_joint(self.joint, self._seen(q) - self._seen(np.zeros_like(q)), load.tau_nm)

    def _seen(self, q: Array) -> Array:
        y, x = (f(q) - self.offset * f(self.phase_rad) for f in (np.sin, np.cos))
        return np.asarray(np.arctan2(y * np.cos(q) - x * np.sin(q), x * np.cos(q) + y * np.sin(q)))


@dataclass(frozen=True)
class FrictionLag(Effect):
    """Friction that holds a joint back on the side it comes from; a short move does not turn it over fully.

    width_rad: from one side to the other; negative if the joint runs past instead. travel_rad: the move after which
    1 - 1/e of the change is done (Dahl 1968, in the position instead of the force). Poses stand in measured order.
    """

    joint: int
    width_rad: float
    travel_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        """Minus half the width, times a state from -1 to 1 that each move draws towards its direction."""
        q, side = load.now.q_rad[:, self.joint - 1], load.now.direction[:, self.joint - 1]
        state = side.copy()  # before the first pose the joint has come a long way
        for row in range(1, len(q)):
            left = np.exp(-abs(q[row] - q[row - 1]) / self.travel_rad)
            state[row] = side[row] + (state[row - 1] - side[row]) * left
        return at_joint(self.joint, -0.5 * self.width_rad * state, load.tau_nm)


@dataclass(frozen=True)
class CablePull(Effect):
    """A cable bundle that is slack up to an angle and tightens beyond, ever stiffer, and so pulls the joint back.

    side: +1 if it tightens above slack_rad, -1 if below. stiffening_rad: the pull grows e-fold faster every so far.
    """

    joint: int
    side: int
    slack_rad: float
    stiffness_nm_per_rad: float
    stiffening_rad: float

    def added_torques(self, load: JointLoad) -> Array:
        """Towards slack, stiffness * s * (exp(x / s) - 1) for an excess x; it reaches the angle by the compliance."""
        excess = np.maximum(0.0, self.side * (load.now.q_rad[:, self.joint - 1] - self.slack_rad))
        pull = self.stiffness_nm_per_rad * self.stiffening_rad * np.expm1(excess / self.stiffening_rad)
        return at_joint(self.joint, -self.side * pull, load.tau_nm)


@dataclass(frozen=True)
class CoupledJoint(Effect):
    """A joint that turns with another one, less and less as that one leaves zero: ratio * bend * sin(q / bend)."""

    joint: int
    by: int
    ratio: float
    bend: float

    def added_angles(self, load: JointLoad) -> Array:
        """In the joint, from the commanded angle of the other."""
        q = load.now.q_rad[:, self.by - 1]
        return at_joint(self.joint, self.ratio * self.bend * np.sin(q / self.bend), load.tau_nm)


@dataclass(frozen=True)
class EntangledJoint(Effect):
    """A joint that turns with two others together; no catalogue has it.

    form: "sum" for sin(q_a + q_b), "product" for sin(q_a) sin(q_b), "beat" for sin(2 q_a) cos(q_b).
    """

    joint: int
    by: tuple[int, int]
    size_rad: float
    form: Literal["sum", "product", "beat"]

    def added_angles(self, load: JointLoad) -> Array:
        """In the joint, from the commanded angles of the two."""
        a, b = (load.now.q_rad[:, joint - 1] for joint in self.by)
        shapes = {"sum": np.sin(a + b), "product": np.sin(a) * np.sin(b), "beat": np.sin(2.0 * a) * np.cos(b)}
        return at_joint(self.joint, self.size_rad * shapes[self.form], load.tau_nm)
