"""Hidden effects of joints whose cause is known and whose form is not the fitted model's: the second catalogue.

Joints count from 1; angles in rad, torques in Nm, times in s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .hidden_effect import HiddenEffect, JointLoad, at_joint
from .screws import Array


@dataclass(frozen=True)
class UnequalPlay(HiddenEffect):
    """Backlash whose two sides differ: up_rad under positive torque, down_rad under negative; tanh(tau / softness)."""

    joint: int
    up_rad: float
    down_rad: float
    softness_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        """The width of the side that the torque presses on."""
        side = np.tanh(load.tau_nm[:, self.joint - 1] / self.softness_nm)
        return at_joint(self.joint, np.where(side > 0.0, self.up_rad, self.down_rad) * side, load.tau_nm)


@dataclass(frozen=True)
class StickSlip(HiddenEffect):
    """Stick-slip: a joint sticks until wound up by stick_rad, then slips; what stays behind grows with the load.

    slip_rad: what a slip leaves without load; growth_per_nm: the share by which each Nm of torque adds to it.
    """

    joint: int
    stick_rad: float
    slip_rad: float
    growth_per_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        """Angles left behind after each move, in measured order."""
        q = load.poses.q_rad[:, self.joint - 1]
        behind = np.empty_like(q)
        now = -self.slip_rad * load.poses.direction[0, self.joint - 1]
        for row, angle in enumerate(q):
            wound = now - (angle - q[row - 1] if row else 0.0)
            now = wound if abs(wound) <= self.stick_rad else float(np.sign(wound)) * self.slip_rad
            behind[row] = now
        pressed = 1.0 + self.growth_per_nm * np.abs(load.tau_nm[:, self.joint - 1])
        return at_joint(self.joint, behind * pressed, load.tau_nm)


@dataclass(frozen=True)
class DahlLoop(HiddenEffect):
    """Friction with memory (Dahl 1968, exponent 2): the state s obeys ds/dq = (1 - s sign(dq))^2 / travel.

    width_rad: of the loop; travel_rad: the move after which half of a reversal from zero is done.
    """

    joint: int
    width_rad: float
    travel_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        """The state's solution over each move, in measured order."""
        q, side = load.poses.q_rad[:, self.joint - 1], load.poses.direction[:, self.joint - 1]
        state = np.zeros_like(q)
        for row in range(1, len(q)):
            gap = 1.0 - state[row - 1] * side[row]
            state[row] = side[row] * (1.0 - gap / (1.0 + gap * abs(q[row] - q[row - 1]) / self.travel_rad))
        return at_joint(self.joint, -0.5 * self.width_rad * state, load.tau_nm)


@dataclass(frozen=True)
class CreepingJoint(HiddenEffect):
    """Creep (Kelvin-Voigt element in series): a part of the compliance follows the torque with a memory of constant_s.

    The torque of a pose acts from one measurement to the next; before the first the joint has settled.
    """

    joint: int
    compliance_rad_per_nm: float
    constant_s: float

    def added_angles(self, load: JointLoad) -> Array:
        """The torque as it was followed so far, an exponential between measurements."""
        tau, time = load.tau_nm[:, self.joint - 1], load.poses.time_s
        kept = np.exp(-np.diff(time) / self.constant_s)
        followed = tau.copy()
        for row, share in enumerate(kept, start=1):
            followed[row] = tau[row] + (followed[row - 1] - tau[row]) * share
        return at_joint(self.joint, self.compliance_rad_per_nm * followed, load.tau_nm)


@dataclass(frozen=True)
class HardStop(HiddenEffect):
    """A stop at at_rad: the joint goes only the share `give` of what it is commanded beyond it, on one side."""

    joint: int
    side: int
    at_rad: float
    give: float
    corner_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        """Angles missing beyond the stop, with a rounded corner."""
        beyond = self.side * (load.poses.q_rad[:, self.joint - 1] - self.at_rad)
        past = 0.5 * (beyond + np.hypot(beyond, self.corner_rad))
        return at_joint(self.joint, -self.side * (1.0 - self.give) * past, load.tau_nm)


@dataclass(frozen=True)
class ToothRipple(HiddenEffect):
    """Error of a gear stage that repeats `waves` times per turn, with half as much at twice that."""

    joint: int
    waves: int
    size_rad: float
    phase_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        """The first and second harmonic."""
        turned = self.waves * load.poses.q_rad[:, self.joint - 1] + self.phase_rad
        ripple = np.sin(turned) + 0.5 * np.cos(2.0 * turned)
        return at_joint(self.joint, self.size_rad * ripple, load.tau_nm)


@dataclass(frozen=True)
class SharedCable(HiddenEffect):
    """A cable over two joints: it tightens with the sum of their angles beyond slack_rad, and pulls on both."""

    joints: tuple[int, int]
    slack_rad: float
    stiffness_nm_per_rad: float

    def added_torques(self, load: JointLoad) -> Array:
        """The cable's pull on both joints, its slack rounded."""
        first, second = (load.poses.q_rad[:, joint - 1] for joint in self.joints)
        pull = -self.stiffness_nm_per_rad * np.logaddexp(0.0, 6.0 * (first + second - self.slack_rad)) / 6.0
        return sum((at_joint(joint, pull, load.tau_nm) for joint in self.joints), np.zeros_like(load.tau_nm))


@dataclass(frozen=True)
class TwoStageWarmUp(HiddenEffect):
    """Warm-up of a joint by motor and housing, each with its own time constant; it cools in the breaks of sessions.

    final_rad, constants_s: of motor and housing. A session lasts from its first measurement to its last.
    """

    joint: int
    final_rad: tuple[float, float]
    constants_s: tuple[float, float]

    def added_angles(self, load: JointLoad) -> Array:
        """The sum of both stages, each by its own exponential within and between sessions."""
        time, session = load.poses.time_s, load.poses.session
        drift = np.zeros_like(time)
        for final, constant in zip(self.final_rad, self.constants_s, strict=True):
            warmth = 1.0 - np.exp(-time[0] / constant)
            for row in range(len(time)):
                if row:
                    target = 1.0 if session[row] == session[row - 1] else 0.0
                    warmth = target + (warmth - target) * np.exp((time[row - 1] - time[row]) / constant)
                drift[row] += final * warmth
        return at_joint(self.joint, drift, load.tau_nm)


@dataclass(frozen=True)
class FormulaJoint(HiddenEffect):
    """Any law: size_rad times a formula in numpy (np) of q and torque (by joint from 1), tau, load_kg, side, time_s."""

    joint: int
    size_rad: float
    formula: str

    def added_angles(self, load: JointLoad) -> Array:
        """The formula's values."""
        poses, at = load.poses, self.joint - 1
        known = {
            "np": np,
            "q": dict(enumerate(poses.q_rad.T, start=1)),
            "torque": dict(enumerate(load.tau_nm.T, start=1)),
            "tau": load.tau_nm[:, at],
            "load_kg": poses.payload_kg,
            "side": poses.direction[:, at],
            "time_s": poses.time_s,
        }
        values = np.asarray(eval(self.formula, known), dtype=float)
        return at_joint(self.joint, self.size_rad * values, load.tau_nm)


@dataclass(frozen=True)
class WeatherLag(HiddenEffect):
    """A joint that follows the room's temperature with a lag; the room swings with period_s, from its mean."""

    joint: int
    swing_rad: float
    period_s: float
    lag_s: float

    def added_angles(self, load: JointLoad) -> Array:
        """The sine after a first-order lag, in steady state."""
        turn = 2.0 * np.pi / self.period_s
        delay = np.arctan(turn * self.lag_s)
        swing = np.cos(delay) * np.sin(turn * load.poses.time_s - delay)
        return at_joint(self.joint, self.swing_rad * swing, load.tau_nm)
