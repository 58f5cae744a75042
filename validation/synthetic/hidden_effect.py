"""Base class of hidden effects: physics that the fitted model does not have, or has in another functional form.

A new effect is a subclass that overrides any of the hooks: of joints in `hidden_joints`, those that remember earlier
poses in `hidden_memory`, of links and base in `hidden_links`, of masses in `hidden_bodies`, of trackers in
`hidden_tracker`. Joints and links count from 1 (link 0: the base).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm_description import ArmDescription
from .screws import Array


@dataclass(frozen=True)
class CommandedPoses:
    """P poses in measured order: commanded q_rad (P, N), direction (P, N) of each joint's last move (-1, 0, 1),
    time_s (P,), session (P,), payload_kg (P,)."""

    arm: ArmDescription
    q_rad: Array
    direction: Array
    time_s: Array
    session: Array
    payload_kg: Array


@dataclass(frozen=True)
class JointLoad:
    """Joint torques tau_nm (P, N) at equilibrium; a positive torque increases the joint angle."""

    poses: CommandedPoses
    tau_nm: Array


@dataclass(frozen=True)
class EndLoad:
    """Wrench on the distal end of a link (0: the base), in its end frame: moment_nm and force_n (P, 3)."""

    poses: CommandedPoses
    link: int
    moment_nm: Array
    force_n: Array


class HiddenEffect:
    """The null effect. Subclasses are frozen dataclasses, whose fields go into the truth file."""

    def flexible_links(self) -> tuple[int, ...]:
        """Links (0: the base) whose `link_deflection` is evaluated."""
        return ()

    def added_masses(self, poses: CommandedPoses) -> Array:
        """Mass errors (P, B) in kg, added to the bodies and the payload."""
        return np.zeros((len(poses.q_rad), len(poses.arm.bodies)))

    def added_com_shifts(self, poses: CommandedPoses) -> Array:
        """Centre-of-mass errors (P, B, 3) in m of the bodies, payload included, in the frames of their `com_m`."""
        return np.zeros((len(poses.q_rad), len(poses.arm.bodies), 3))

    def added_torques(self, load: JointLoad) -> Array:
        """Joint torques (P, N) in Nm, added to those of gravity, `load.tau_nm`."""
        return np.zeros_like(load.tau_nm)

    def added_angles(self, load: JointLoad) -> Array:
        """Joint angle errors (P, N) in rad, beside the linear spring; `load.tau_nm` includes the added torques."""
        return np.zeros_like(load.tau_nm)

    def link_deflection(self, load: EndLoad) -> Array:
        """Rotation vector in rad and displacement in m (P, 6) of the link's distal end, in its end frame."""
        return np.zeros((len(load.force_n), 6))

    def measurement_error(self, tcp_m: Array) -> Array:
        """Systematic error (P, 3) in m of the tracker at true TCP positions (P, 3), in world axes."""
        return np.zeros_like(tcp_m)


def at_joint(joint: int, values: Array, like: Array) -> Array:
    """Array (P, N) with the values (P,) in the column of one joint (from 1), zero elsewhere; `like` gives the shape."""
    columns = np.zeros_like(like)
    columns[:, joint - 1] = values
    return columns


def past(values: Array) -> Array:
    """(P,), sum of what came before each pose."""
    return np.append(0.0, np.cumsum(values)[:-1])


@dataclass(frozen=True)
class JointError(HiddenEffect):
    """An error of one joint's angle."""

    joint: int

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        """Error (P,) in rad at that joint's commanded angles q (P,) in rad under its torques tau (P,) in Nm."""
        raise NotImplementedError

    def added_angles(self, load: JointLoad) -> Array:
        q, tau = load.poses.q_rad[:, self.joint - 1], load.tau_nm[:, self.joint - 1]
        return at_joint(self.joint, self.error(q, tau, load.poses), load.tau_nm)

    def direction(self, poses: CommandedPoses) -> Array:
        """(P,), sign of the joint's last move."""
        return poses.direction[:, self.joint - 1]


@dataclass(frozen=True)
class LinkError(HiddenEffect):
    """An end of a link (0: the base) that turns or shifts."""

    link: int

    def flexible_links(self) -> tuple[int, ...]:
        return (self.link,)

    def turn(self, load: EndLoad) -> Array:
        """Rotation vector (P, 3), rad, in the end frame."""
        return np.zeros_like(load.force_n)

    def shift(self, load: EndLoad) -> Array:
        """Displacement (P, 3), m, in the end frame."""
        return np.zeros_like(load.force_n)

    def link_deflection(self, load: EndLoad) -> Array:
        return np.hstack([self.turn(load), self.shift(load)])


class BaseError(HiddenEffect):
    """A base that turns."""

    def flexible_links(self) -> tuple[int, ...]:
        return (0,)

    def turn(self, load: EndLoad) -> Array:
        """Rotation vector (P, 3), rad, in the base frame."""
        raise NotImplementedError

    def link_deflection(self, load: EndLoad) -> Array:
        turn = self.turn(load)
        return np.hstack([turn, np.zeros_like(turn)])
