"""Hidden effects of joints that depend on the pose alone: gear, servo, spring, cable. In rad, Nm, m.

*Right* names what leads to the part that is at fault, where the tool has no effect of that kind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm_description import Vector3
from .generate import nominal_tip
from .hidden_effect import CommandedPoses, HiddenEffect, JointError, JointLoad, at_joint
from .screws import Array

STEP_RAD = 1e-5
"""Of a difference quotient."""


@dataclass(frozen=True)
class SoftPlay(JointError):
    """Smoothed backlash: half the width times tau / sqrt(tau^2 + softness^2)."""

    width_rad: float
    softness_nm: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        return 0.5 * self.width_rad * tau / np.hypot(tau, self.softness_nm)


@dataclass(frozen=True)
class DifferentialPlay(HiddenEffect):
    """Play in a differential: both joints err together, to the side of their torques' sum. Right: their backlash."""

    joints: tuple[int, int]
    width_rad: float
    softness_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        tau = sum(load.tau_nm[:, joint - 1] for joint in self.joints)
        side = 0.5 * self.width_rad * np.tanh(tau / self.softness_nm)
        return sum((at_joint(joint, side, load.tau_nm) for joint in self.joints), np.zeros_like(load.tau_nm))


@dataclass(frozen=True)
class HardeningSpring(JointError):
    """Hardening torsional stiffness: the linear spring becomes size * asinh(tau / scale) for large torques.

    size / scale must stay below the joint's linear compliance, else the total compliance becomes negative.
    """

    size_rad: float
    scale_nm: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        x = tau / self.scale_nm
        return self.size_rad * (np.arcsinh(x) - x)


@dataclass(frozen=True)
class OneSidedGain(JointError):
    """Gain error of a servo on one side (+1 or -1) of zero only, with a hyperbolic corner at zero."""

    side: int
    gain: float
    corner_rad: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        out = self.side * q
        ramp = 0.5 * (out + np.hypot(out, self.corner_rad) - self.corner_rad)
        return self.side * self.gain * ramp


@dataclass(frozen=True)
class HardStop(JointError):
    """A stop at at_rad: beyond it, on one side, the joint goes only the share `give` of what it is commanded."""

    side: int
    at_rad: float
    give: float
    corner_rad: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        beyond = self.side * (q - self.at_rad)
        past = 0.5 * (beyond + np.hypot(beyond, self.corner_rad))
        return -self.side * (1.0 - self.give) * past


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
class EccentricShaft(JointError):
    """Eccentricity of an angle sensor or servo horn: angle about the eccentric centre less that at zero.

    offset: eccentricity over the radius at which the angle is taken; phase_rad: its direction.
    """

    offset: float
    phase_rad: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        return self._seen(q) - self._seen(np.zeros_like(q))

    def _seen(self, q: Array) -> Array:
        y, x = (f(q) - self.offset * f(self.phase_rad) for f in (np.sin, np.cos))
        return np.asarray(np.arctan2(y * np.cos(q) - x * np.sin(q), x * np.cos(q) + y * np.sin(q)))


@dataclass(frozen=True)
class ToothRipple(JointError):
    """Error of a gear stage that repeats `waves` times per turn, with half as much at twice that."""

    waves: int
    size_rad: float
    phase_rad: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        turned = self.waves * q + self.phase_rad
        return self.size_rad * (np.sin(turned) + 0.5 * np.cos(2.0 * turned))


@dataclass(frozen=True)
class BeltPolygon(JointError):
    """A toothed belt that lies round its small wheel as a polygon: a ripple of every tooth.

    Right: gear_ripple, which the tool has since: a wave of as many cycles a turn as teeth, the first harmonic of these
    arcs, has 90/π⁴ = 92 % of their square.
    """

    teeth: int
    size_rad: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        within = q * self.teeth / (2.0 * np.pi) % 1.0
        return self.size_rad * (8.0 * within * (1.0 - within) - 4.0 / 3.0)


@dataclass(frozen=True)
class CoupledJoint(JointError):
    """Coupling of a joint to the angle of another one: ratio * bend * sin(q / bend), of slope `ratio` at zero."""

    by: int
    ratio: float
    bend: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        return self.ratio * self.bend * np.sin(poses.q_rad[:, self.by - 1] / self.bend)


@dataclass(frozen=True)
class FormulaJoint(HiddenEffect):
    """Any law: size_rad times a formula in numpy (np).

    Of q (rad) and torque (N·m) by joint from 1, of the joint's own tau, the side that it came from (side) and the way
    of every joint to the pose (way, rad), of load_kg and time_s.
    """

    joint: int
    size_rad: float
    formula: str

    def added_angles(self, load: JointLoad) -> Array:
        poses, at = load.poses, self.joint - 1
        known = {
            "np": np,
            "q": dict(enumerate(poses.q_rad.T, start=1)),
            "torque": dict(enumerate(load.tau_nm.T, start=1)),
            "tau": load.tau_nm[:, at],
            "load_kg": poses.payload_kg,
            "side": poses.direction[:, at],
            "way": dict(enumerate(np.diff(poses.q_rad, axis=0, prepend=0.0).T, start=1)),
            "time_s": poses.time_s,
        }
        values = np.asarray(eval(self.formula, known), dtype=float)
        return at_joint(self.joint, self.size_rad * values, load.tau_nm)


@dataclass(frozen=True)
class CablePull(HiddenEffect):
    """Restoring torque of a cable bundle that is slack up to an angle and stiffens exponentially beyond.

    Torque -stiffness * s * (exp(x / s) - 1) at excess x acts through the joint's compliance. side: +1 if it tightens
    above slack_rad, -1 if below. stiffening_rad: s, the angle over which its stiffness grows e-fold.
    """

    joint: int
    side: int
    slack_rad: float
    stiffness_nm_per_rad: float
    stiffening_rad: float

    def added_torques(self, load: JointLoad) -> Array:
        excess = np.maximum(0.0, self.side * (load.poses.q_rad[:, self.joint - 1] - self.slack_rad))
        pull = self.stiffness_nm_per_rad * self.stiffening_rad * np.expm1(excess / self.stiffening_rad)
        return at_joint(self.joint, -self.side * pull, load.tau_nm)


@dataclass(frozen=True)
class SharedCable(HiddenEffect):
    """A cable over two joints: it tightens with the sum of their angles beyond slack_rad, and pulls on both."""

    joints: tuple[int, int]
    slack_rad: float
    stiffness_nm_per_rad: float

    def added_torques(self, load: JointLoad) -> Array:
        first, second = (load.poses.q_rad[:, joint - 1] for joint in self.joints)
        pull = -self.stiffness_nm_per_rad * np.logaddexp(0.0, 6.0 * (first + second - self.slack_rad)) / 6.0
        return sum((at_joint(joint, pull, load.tau_nm) for joint in self.joints), np.zeros_like(load.tau_nm))


@dataclass(frozen=True)
class TwoJointSpring(HiddenEffect):
    """A balancing spring from the foot to the forearm, over joints 2 and 3, that was not described.

    Right: cable_spring of either joint. Levers in m, in the plane of the arm.
    """

    foot_m: tuple[float, float]
    upper_m: float
    fore_m: float
    slack_m: float
    stiffness_n_per_m: float

    def added_torques(self, load: JointLoad) -> Array:
        q2, q3 = load.poses.q_rad[:, 1], load.poses.q_rad[:, 2]
        torques = np.zeros_like(load.tau_nm)
        for column, (by2, by3) in ((1, (STEP_RAD, 0.0)), (2, (0.0, STEP_RAD))):
            torques[:, column] = (self._energy(q2 - by2, q3 - by3) - self._energy(q2 + by2, q3 + by3)) / 2 / STEP_RAD
        return torques

    def _energy(self, q2: Array, q3: Array) -> Array:
        along = self.upper_m * np.cos(q2) + self.fore_m * np.cos(q2 + q3) - self.foot_m[0]
        up = self.upper_m * np.sin(q2) + self.fore_m * np.sin(q2 + q3) - self.foot_m[1]
        stretch = np.maximum(np.hypot(along, up) - self.slack_m, 0.0)
        return np.asarray(0.5 * self.stiffness_n_per_m * stretch**2)


@dataclass(frozen=True)
class MagnetByTheArm(HiddenEffect):
    """A magnet beside the arm draws the steel of the gripper to itself, most when near. No name says so."""

    where_m: Vector3
    force_n: float
    range_m: float

    def added_torques(self, load: JointLoad) -> Array:
        """Work of the force over a small turn of each joint."""
        arm, tip = load.poses.arm, nominal_tip(load.poses.arm, load.poses.q_rad)
        apart = np.array(self.where_m) - tip
        far = np.linalg.norm(apart, axis=1, keepdims=True)
        force = self.force_n * apart / far / (1.0 + (far / self.range_m) ** 2)
        torques = np.zeros_like(load.tau_nm)
        for joint in range(torques.shape[1]):
            q = load.poses.q_rad.copy()
            q[:, joint] += STEP_RAD
            torques[:, joint] = ((nominal_tip(arm, q) - tip) * force).sum(axis=1) / STEP_RAD
        return torques
