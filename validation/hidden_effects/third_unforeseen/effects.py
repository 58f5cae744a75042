"""Causes of the fifth part of the second catalogue, each with the names that would be right, as decided beforehand.

A name is right if whoever reads it looks for the fault in the right part, and for one of the right kind. Joints and
links count from 1 (link 0: the base).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from validation.hidden_effects.second_unforeseen.effects import ShiftedLink, rigid_torque
from validation.synthetic import CommandedPoses, EndLoad, GroundTruth, HiddenEffect, JointLoad
from validation.synthetic.arm_description import Vector3
from validation.synthetic.chain import forward_kinematics, zero_configuration
from validation.synthetic.hidden_effect import at_joint

STEP_RAD = 1e-5


@dataclass(frozen=True)
class MagnetByTheArm(HiddenEffect):
    """A magnet beside the arm draws the steel of the gripper to itself, most when near. No name says so."""

    where_m: Vector3
    force_n: float
    range_m: float

    def added_torques(self, load: JointLoad) -> Array:
        tip = _tip(load.poses, load.poses.q_rad)
        apart = np.array(self.where_m) - tip
        far = np.linalg.norm(apart, axis=1, keepdims=True)
        force = self.force_n * apart / far / (1.0 + (far / self.range_m) ** 2)
        torques = np.zeros_like(load.tau_nm)
        for joint in range(torques.shape[1]):
            q = load.poses.q_rad.copy()
            q[:, joint] += STEP_RAD
            torques[:, joint] = ((_tip(load.poses, q) - tip) * force).sum(axis=1) / STEP_RAD
        return torques


@dataclass(frozen=True)
class CyclicDistance(HiddenEffect):
    """A distance meter that counts phases: its distance errs by a wave of half the wavelength. No name says so."""

    meter_m: Vector3
    half_wave_m: float
    size_m: float

    def measurement_error(self, tcp_m: Array) -> Array:
        sight = tcp_m - np.array(self.meter_m)
        far = np.linalg.norm(sight, axis=1, keepdims=True)
        return np.asarray(self.size_m * np.sin(2.0 * np.pi * far / self.half_wave_m) * sight / far)


@dataclass(frozen=True)
class OvalFlexspline(HiddenEffect):
    """A strain wave gear that is stiffer at two opposite angles than between them.

    Right: nonlinear_stiffness of the joint, whose stiffness is not constant.
    """

    joint: int
    compliance_rad_per_nm: float
    phase_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        q, tau = load.poses.q_rad[:, self.joint - 1], load.tau_nm[:, self.joint - 1]
        return at_joint(self.joint, self.compliance_rad_per_nm * tau * np.cos(2.0 * q + self.phase_rad), load.tau_nm)


@dataclass(frozen=True)
class SwellingLink(ShiftedLink):
    """A link of nylon that takes up water while it is measured, and grows. No name says so."""

    growth_m: Vector3

    def shift(self, load: EndLoad) -> Array:
        time = load.poses.time_s
        return np.asarray(np.sqrt(time / time.max())[:, None] * np.array(self.growth_m))


@dataclass(frozen=True)
class LevellingTable(HiddenEffect):
    """A table on air springs that level it again within some poses: it tilts by what the moment has changed.

    Right: base_compliance.
    """

    turn_rad_per_nm: float
    share_per_pose: float

    def flexible_links(self) -> tuple[int, ...]:
        return (0,)

    def link_deflection(self, load: EndLoad) -> Array:
        levelled = np.zeros_like(load.moment_nm)
        for row in range(1, len(levelled)):
            before = levelled[row - 1]
            levelled[row] = before + self.share_per_pose * (load.moment_nm[row - 1] - before)
        turn = self.turn_rad_per_nm * (load.moment_nm - levelled) * np.array([1.0, 1.0, 0.0])
        return np.hstack([turn, np.zeros_like(turn)])


@dataclass(frozen=True)
class SofteningByHeat(HiddenEffect):
    """A gear of plastic that its own servo heats by the square of the torque, and that gives way more when hot.

    Right: nonlinear_stiffness (it gives way more after large torques) or drift (it warms up) of the joint.
    """

    joint: int
    compliance_rad_per_nm: float
    settling_s: float

    def added_angles(self, load: JointLoad) -> Array:
        power, heat = rigid_torque(load.poses, self.joint) ** 2, np.zeros(len(load.tau_nm))
        for row, lasts in enumerate(np.diff(load.poses.time_s), start=1):
            heat[row] = heat[row - 1] + (power[row - 1] - heat[row - 1]) * -np.expm1(-lasts / self.settling_s)
        hot = heat / power.mean()
        return at_joint(self.joint, self.compliance_rad_per_nm * hot * load.tau_nm[:, self.joint - 1], load.tau_nm)


@dataclass(frozen=True)
class RoutedBowden(HiddenEffect):
    """A joint's Bowden cable that runs over the joint before, which drags it along by the friction in its sheath.

    Right: hysteresis of the cable's joint, or its coupling to the joint before.
    """

    joint: int
    over: int
    size_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        moves = np.diff(load.poses.q_rad[:, self.over - 1], prepend=0.0)
        return at_joint(self.joint, -self.size_rad * np.tanh(moves / 0.1), load.tau_nm)


@dataclass(frozen=True)
class TwoJointSpring(HiddenEffect):
    """A balancing spring from the foot to the forearm, over joints 2 and 3, which nobody told of.

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
class StuckBit(HiddenEffect):
    """An encoder of which one bit is stuck at 0: half of all angles are read too small by it. No name says so."""

    joint: int
    bit_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        set_bit = np.floor(load.poses.q_rad[:, self.joint - 1] / self.bit_rad) % 2.0
        return at_joint(self.joint, self.bit_rad * set_bit, load.tau_nm)


@dataclass(frozen=True)
class ProbePretravel(HiddenEffect):
    """A touching probe that is bent by the same length whichever way the tip comes. No name says so."""

    length_m: float

    def measurement_error(self, tcp_m: Array) -> Array:
        way = np.diff(tcp_m, axis=0, prepend=tcp_m[:1])
        return np.asarray(-self.length_m * way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9))


def _tip(poses: CommandedPoses, q_rad: Array) -> Array:
    """Positions (P, 3) of the tip of the arm as described."""
    chain = zero_configuration(poses.arm, GroundTruth.nominal(poses.arm))
    return np.asarray(forward_kinematics(chain, np.zeros(len(q_rad)), q_rad, {}).tcp)
