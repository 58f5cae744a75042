"""Causes of the fourth part of the second catalogue, each with the names that would be right, as decided beforehand.

A name is right if whoever reads it looks for the fault in the right part, and for one of the right kind. Joints and
links count from 1 (link 0: the base).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from validation.synthetic import CommandedPoses, EndLoad, GroundTruth, HiddenEffect, JointLoad, true_state
from validation.synthetic.arm_description import Vector3
from validation.synthetic.chain import forward_kinematics, zero_configuration
from validation.synthetic.hidden_effect import at_joint


@dataclass(frozen=True)
class ShiftedLink(HiddenEffect):
    """A link whose end is displaced without turning."""

    link: int

    def flexible_links(self) -> tuple[int, ...]:
        return (self.link,)

    def shift(self, load: EndLoad) -> Array:
        """Displacement (P, 3), m, in the end frame."""
        raise NotImplementedError

    def link_deflection(self, load: EndLoad) -> Array:
        shift = self.shift(load)
        return np.hstack([np.zeros_like(shift), shift])


@dataclass(frozen=True)
class EmptyingBattery(HiddenEffect):
    """A battery that runs down: all servos hold their angles less and less stiffly. No name says so."""

    compliance_rad_per_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        time = load.poses.time_s
        return np.asarray(self.compliance_rad_per_nm * (time / time.max())[:, None] * load.tau_nm)


@dataclass(frozen=True)
class OverloadProtection(HiddenEffect):
    """A bus servo that weakens itself once it has held a large torque in two poses running.

    Right: nonlinear_stiffness, as the joint gives way more under a large torque.
    """

    joint: int
    limit_nm: float
    compliance_rad_per_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        tau = load.tau_nm[:, self.joint - 1]
        before = np.append(0.0, np.abs(rigid_torque(load.poses, self.joint))[:-1]) > self.limit_nm
        large = 0.5 + 0.5 * np.tanh((np.abs(tau) - self.limit_nm) / (0.25 * self.limit_nm))
        return at_joint(self.joint, self.compliance_rad_per_nm * tau * large * before, load.tau_nm)


@dataclass(frozen=True)
class DifferentialPlay(HiddenEffect):
    """Play in a differential: both joints that it turns err together, to the side of the sum of their torques.

    Right: backlash of either joint.
    """

    joints: tuple[int, int]
    width_rad: float
    softness_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        tau = sum(load.tau_nm[:, joint - 1] for joint in self.joints)
        side = 0.5 * self.width_rad * np.tanh(tau / self.softness_nm)
        return sum((at_joint(joint, side, load.tau_nm) for joint in self.joints), np.zeros_like(load.tau_nm))


@dataclass(frozen=True)
class CapstanFriction(HiddenEffect):
    """A string drive whose friction grows e-fold with the angle that the string is wrapped by (Euler, Eytelwein).

    Right: hysteresis of the joint.
    """

    joint: int
    size_rad: float
    friction: float

    def added_angles(self, load: JointLoad) -> Array:
        q, side = (values[:, self.joint - 1] for values in (load.poses.q_rad, load.poses.direction))
        return at_joint(self.joint, -self.size_rad * side * np.exp(self.friction * q), load.tau_nm)


@dataclass(frozen=True)
class WobblingTurntable(HiddenEffect):
    """A turntable bearing under joint 1 with two high spots: the axis nods twice a turn. No name says so."""

    tilt_rad: float

    def flexible_links(self) -> tuple[int, ...]:
        return (0,)

    def link_deflection(self, load: EndLoad) -> Array:
        twice = 2.0 * load.poses.q_rad[:, 0]
        turn = self.tilt_rad * np.stack([np.cos(twice), np.sin(twice)], axis=1)
        return np.hstack([turn, np.zeros((len(turn), 4))])


@dataclass(frozen=True)
class ShearingPlates(ShiftedLink):
    """A link of two thin plates that shifts sideways as a parallelogram does, without turning.

    Right: lateral_compliance of the link.
    """

    shift_m_per_n: float

    def shift(self, load: EndLoad) -> Array:
        return np.asarray(self.shift_m_per_n * load.force_n * np.array([1.0, 0.0, 0.0]))


@dataclass(frozen=True)
class TelescopingTube(ShiftedLink):
    """A tube that slips into its clamp by and by, whenever weight presses along it. No name says so.

    shift_m: in all, had it always been pressed by 3 N.
    """

    shift_m: float

    def shift(self, load: EndLoad) -> Array:
        pressed = np.maximum(-load.force_n[:, 2], 0.0) / 3.0
        slipped = self.shift_m * np.append(0.0, np.cumsum(pressed)[:-1]) / len(pressed)
        return np.asarray(-slipped[:, None] * np.array([0.0, 0.0, 1.0]))


@dataclass(frozen=True)
class GlareSpot(ShiftedLink):
    """A glossy ball seen from above: its bright spot moves to the side of the lamp on the flange. No name says so."""

    size_m: float

    def shift(self, load: EndLoad) -> Array:
        down = load.force_n / np.linalg.norm(load.force_n, axis=1, keepdims=True)
        return np.asarray(self.size_m * (np.array([0.0, 0.0, 1.0]) - down[:, 2:] * down))


@dataclass(frozen=True)
class StereoSteps(HiddenEffect):
    """Two cameras that match whole pixels: the distance comes in steps that grow with its square. No name says so."""

    camera_m: Vector3
    step_per_m: float

    def measurement_error(self, tcp_m: Array) -> Array:
        sight = tcp_m - np.array(self.camera_m)
        far = np.linalg.norm(sight, axis=1, keepdims=True)
        seen = 1.0 / (np.round(1.0 / far / self.step_per_m) * self.step_per_m)
        return np.asarray((seen / far - 1.0) * sight)


@dataclass(frozen=True)
class MarkerOnJaw(ShiftedLink):
    """A target on the gripper's moving jaw, which stands elsewhere when it holds the load. No name says so."""

    shift_m: Vector3

    def shift(self, load: EndLoad) -> Array:
        return np.asarray((load.poses.payload_kg > 0.0)[:, None] * np.array(self.shift_m))


@dataclass(frozen=True)
class FoamMat(HiddenEffect):
    """A mat of foam that the gripper sinks into where a pose is too low: it is lifted by a share. No name says so."""

    top_m: float
    share: float

    def measurement_error(self, tcp_m: Array) -> Array:
        error = np.zeros_like(tcp_m)
        error[:, 2] = self.share * np.maximum(self.top_m - tcp_m[:, 2], 0.0)
        return error


@dataclass(frozen=True)
class WalkingBase(HiddenEffect):
    """A base that nobody screwed down: each wide swing of joint 1 turns it a little, less against its cable.

    Right: whatever moves the base, or joint 1 about the same axis, with time.
    """

    share: float
    from_rad: float

    def flexible_links(self) -> tuple[int, ...]:
        return (0,)

    def link_deflection(self, load: EndLoad) -> Array:
        swing = np.diff(load.poses.q_rad[:, 0], prepend=0.0)
        slips = self.share * np.sign(swing) * np.maximum(np.abs(swing) - self.from_rad, 0.0)
        turn = np.zeros((len(swing), 6))
        turn[:, 2] = -np.cumsum(np.where(slips > 0.0, slips, 0.85 * slips))
        return turn


@dataclass(frozen=True)
class SlippingClutch(HiddenEffect):
    """A servo saver that slips by and by under large torques, and stays where it slipped to.

    Right: change_point (what slips stands elsewhere later); a drift would say that it warms up.
    """

    joint: int
    limit_nm: float
    slip_rad_per_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        tau = rigid_torque(load.poses, self.joint)
        slips = np.sign(tau) * np.maximum(np.abs(tau) - self.limit_nm, 0.0)
        return at_joint(self.joint, self.slip_rad_per_nm * np.append(0.0, np.cumsum(slips)[:-1]), load.tau_nm)


@dataclass(frozen=True)
class HangingHose(HiddenEffect):
    """A hose from the floor to the gripper: the higher the tip, the more of it hangs there.

    Right: mass of a last link, as a link is heavier than it was weighed, or payload.
    """

    mass_kg_per_m: float

    def added_masses(self, poses: CommandedPoses) -> Array:
        chain = zero_configuration(poses.arm, GroundTruth.nominal(poses.arm))
        tip = forward_kinematics(chain, np.zeros(len(poses.q_rad)), poses.q_rad, {}).tcp
        masses = super().added_masses(poses)
        masses[:, -1] = self.mass_kg_per_m * np.maximum(tip[:, 2], 0.0)
        return masses


@dataclass(frozen=True)
class HelicalThrust(ShiftedLink):
    """Helical gears that press the shaft along its axis, to the side of the torque. Right: axial_play of the joint."""

    float_m: float
    softness_nm: float

    def shift(self, load: EndLoad) -> Array:
        along = self.float_m * np.tanh(load.moment_nm[:, 2] / self.softness_nm)
        return np.asarray(along[:, None] * np.array([0.0, 0.0, 1.0]))


@dataclass(frozen=True)
class FanCycles(HiddenEffect):
    """A fan that goes on and off: a joint warms and cools by turns. Right: drift of the joint."""

    joint: int
    size_rad: float
    period_s: float

    def added_angles(self, load: JointLoad) -> Array:
        part = load.poses.time_s / self.period_s % 1.0
        since = np.exp(-4.0 * (part % 0.5)) / (1.0 + np.exp(-2.0))
        return at_joint(self.joint, self.size_rad * np.where(part < 0.5, 1.0 - since, since), load.tau_nm)


@dataclass(frozen=True)
class RingingTip(HiddenEffect):
    """A tip that still rings as it is measured, the more the longer its way was. No name says so."""

    share: float
    seed: int

    def measurement_error(self, tcp_m: Array) -> Array:
        way = np.linalg.norm(np.diff(tcp_m, axis=0, prepend=tcp_m[:1]), axis=1, keepdims=True)
        return np.asarray(self.share * way * np.random.default_rng(self.seed).normal(size=tcp_m.shape))


@dataclass(frozen=True)
class BeltPolygon(HiddenEffect):
    """A toothed belt that lies round its small wheel as a polygon: a ripple of every tooth. No name says so."""

    joint: int
    teeth: int
    size_rad: float

    def added_angles(self, load: JointLoad) -> Array:
        within = load.poses.q_rad[:, self.joint - 1] * self.teeth / (2.0 * np.pi) % 1.0
        return at_joint(self.joint, self.size_rad * (8.0 * within * (1.0 - within) - 4.0 / 3.0), load.tau_nm)


def rigid_torque(poses: CommandedPoses, joint: int) -> Array:
    """Torque (P,) about a joint of the arm as described: what a pose does to later ones must not depend on these."""
    state = true_state(poses.arm, GroundTruth.nominal(poses.arm), poses.q_rad, poses.payload_kg)
    return state.tau_nm[:, joint - 1]
