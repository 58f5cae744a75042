"""Hidden effects: physics that the fitted model does not know, or knows in another shape.

Every effect may act at any of the hooks of Effect; the defaults do nothing. A new effect is a new subclass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .rig import Rig, Vector
from .screws import Array

if TYPE_CHECKING:
    from .chain import Posture


@dataclass(frozen=True)
class Situation:
    """P measured poses: commanded q_rad (P, N), direction (P, N) of each joint's last move (-1, 0, 1), time_s (P,),
    session (P,), payload_kg (P,)."""

    rig: Rig
    q_rad: Array
    direction: Array
    time_s: Array
    session: Array
    payload_kg: Array


@dataclass(frozen=True)
class JointLoad:
    """tau_nm (P, N) about the joints in the posture, added to the joint angle if positive."""

    now: Situation
    posture: Posture
    tau_nm: Array


@dataclass(frozen=True)
class EndLoad:
    """Load on the far end of a link (0: the base), in its end frame: moment_nm and force_n (P, 3)."""

    now: Situation
    link: int
    moment_nm: Array
    force_n: Array


@dataclass(frozen=True)
class Sight:
    """True tcp_m (P, 3) in world axes, as the tracker stands before it."""

    now: Situation
    tcp_m: Array


class Effect:
    """An effect that does nothing. Subclasses are frozen dataclasses, whose fields go into the truth file."""

    def bent_links(self) -> tuple[int, ...]:
        """Links (0: the base) for which link_bend is to be asked."""
        return ()

    def added_masses(self, now: Situation) -> Array:
        """(P, B) in kg, on top of the bodies and the payload."""
        return np.zeros((len(now.q_rad), len(now.rig.bodies)))

    def added_torques(self, load: JointLoad) -> Array:
        """(P, N) in Nm, on top of gravity; load.tau_nm is that of gravity."""
        return np.zeros_like(load.tau_nm)

    def added_angles(self, load: JointLoad) -> Array:
        """(P, N) in rad, on top of command and linear spring; load.tau_nm includes the added torques."""
        return np.zeros_like(load.tau_nm)

    def link_bend(self, load: EndLoad) -> Array:
        """Rotation vector in rad and deflection in m (P, 6) of the link's far end, in its end frame."""
        return np.zeros((len(load.force_n), 6))

    def seen_shift(self, sight: Sight) -> Array:
        """(P, 3) in m: how far the tracker sees the TCP from where it is."""
        return np.zeros_like(sight.tcp_m)


@dataclass(frozen=True)
class SoftPlay(Effect):
    """Play that a torque takes up gradually: half the width times tau / sqrt(tau^2 + softness^2)."""

    joint: int
    width_rad: float
    softness_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        """The joint lies towards the side to which the torque pushes it."""
        angles = np.zeros_like(load.tau_nm)
        tau = load.tau_nm[:, self.joint - 1]
        angles[:, self.joint - 1] = 0.5 * self.width_rad * tau / np.hypot(tau, self.softness_nm)
        return angles


@dataclass(frozen=True)
class LinkBending(Effect):
    """A link as a cantilever beam (Euler, Bernoulli) loaded at its end.

    along and across are unit vectors in the link's end frame: the beam's direction and its first transverse axis.
    stiffness_nm2: flexural rigidity E I against turning about the first and the second transverse axis.
    """

    link: int
    length_m: float
    stiffness_nm2: tuple[float, float]
    along: Vector = (0.0, 0.0, 1.0)
    across: Vector = (1.0, 0.0, 0.0)

    def bent_links(self) -> tuple[int, ...]:
        """The one link."""
        return (self.link,)

    def link_bend(self, load: EndLoad) -> Array:
        """End rotation M l / EI + F l^2 / 2 EI and end deflection M l^2 / 2 EI + F l^3 / 3 EI, in both planes."""
        if load.link != self.link:
            return super().link_bend(load)
        along, first = np.array(self.along), np.array(self.across)
        bend = np.zeros((len(load.force_n), 6))
        for axis, rigidity in zip((first, np.cross(along, first)), self.stiffness_nm2, strict=True):
            sideways = np.cross(axis, along)
            moment, force, length = load.moment_nm @ axis, load.force_n @ sideways, self.length_m
            turn = (moment * length + force * length**2 / 2.0) / rigidity
            shift = (moment * length**2 / 2.0 + force * length**3 / 3.0) / rigidity
            bend[:, :3] += turn[:, None] * axis
            bend[:, 3:] += shift[:, None] * sideways
        return bend
