"""What hidden effects are given and where they may act: physics that the fitted model does not know, or knows in
another shape.

Every effect may act at any of the hooks of Effect; the defaults do nothing. A new effect is a new subclass. Those that
there are stand in hidden_joints, hidden_bodies, hidden_times and hidden_sight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .rig import Rig
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

    def added_shifts(self, now: Situation) -> Array:
        """(P, B, 3) in m: how far the centre of each body, payload included, is off, in the frame it is given in."""
        return np.zeros((len(now.q_rad), len(now.rig.bodies), 3))

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


def at_joint(joint: int, values: Array, like: Array) -> Array:
    """(P, N) like the given array: values (P,) in the column of that joint (from 1), zero elsewhere."""
    columns = np.zeros_like(like)
    columns[:, joint - 1] = values
    return columns
