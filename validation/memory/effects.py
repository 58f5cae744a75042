"""Hidden causes with a memory, written from their physics: they share no code with the tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from validation.synthetic import EndLoad, HiddenEffect, JointLoad
from validation.synthetic.hidden_effect import at_joint
from validation.synthetic.screws import Array


def yielded(drive: Array, time_s: Array, constant_s: float, late: float, fresh: bool) -> Array:
    """(P,), state of a dashpot with time constant constant_s that follows drive (P,).

    The arm leaves for a pose when the share `late` of the time between two readings has passed. Before the first
    reading it had stood there for hours, or, if fresh, hung unloaded.
    """
    state = np.empty_like(drive)
    state[0] = 0.0 if fresh else drive[0]
    for row in range(1, len(drive)):
        pause = time_s[row] - time_s[row - 1]
        left = drive[row - 1] + (state[row - 1] - drive[row - 1]) * np.exp(-late * pause / constant_s)
        state[row] = drive[row] + (left - drive[row]) * np.exp(-(1.0 - late) * pause / constant_s)
    return state


@dataclass(frozen=True)
class ViscoelasticJoint(HiddenEffect):
    """A dashpot beside a spring, behind the joint's own spring."""

    joint: int
    compliance_rad_per_nm: float
    constant_s: float
    late: float = 0.0
    fresh: bool = False

    def added_angles(self, load: JointLoad) -> Array:
        """The spring's deflection as far as the dashpot has let it."""
        tau, time = load.tau_nm[:, self.joint - 1], load.poses.time_s
        state = yielded(tau, time, self.constant_s, self.late, self.fresh)
        return at_joint(self.joint, self.compliance_rad_per_nm * state, load.tau_nm)


@dataclass(frozen=True)
class ViscoelasticBase(HiddenEffect):
    """A base that tilts slowly under the moment on it, about the two horizontal axes of the world."""

    compliance_rad_per_nm: tuple[float, float]
    constant_s: float
    late: float = 0.0

    def flexible_links(self) -> tuple[int, ...]:
        """The base."""
        return (0,)

    def link_deflection(self, load: EndLoad) -> Array:
        """Tilt about x and y, which on this arm are not those of the base's own frame: that leans by 60 degrees."""
        bend, moment = np.zeros((len(load.force_n), 6)), load.moment_nm @ self._turn(load).T
        for axis, compliance in enumerate(self.compliance_rad_per_nm):
            followed = yielded(moment[:, axis], load.poses.time_s, self.constant_s, self.late, False)
            bend[:, axis] = compliance * followed
        bend[:, :3] = bend[:, :3] @ self._turn(load)
        return bend

    @staticmethod
    def _turn(load: EndLoad) -> Array:
        """(3, 3), from the frame of the base as drawn to the world's."""
        (cx, cy, cz), (sx, sy, sz) = np.cos(load.poses.arm.base.angles_rad), np.sin(load.poses.arm.base.angles_rad)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(about_x @ about_y @ about_z)


@dataclass(frozen=True)
class HeatedServo(HiddenEffect):
    """A servo whose zero and scale move with its own temperature, which losses of the holding current (τ²) make."""

    joint: int
    zero_rad_per_nm2: float
    scale_per_nm2: float
    constant_s: float

    def added_angles(self, load: JointLoad) -> Array:
        """Cold at the start."""
        loss, time = load.tau_nm[:, self.joint - 1] ** 2, load.poses.time_s
        heat = yielded(loss, time, self.constant_s, 0.0, True)
        q = load.poses.q_rad[:, self.joint - 1]
        return at_joint(self.joint, (self.zero_rad_per_nm2 + self.scale_per_nm2 * q) * heat, load.tau_nm)


@dataclass(frozen=True)
class SlippingHorn(HiddenEffect):
    """A horn that slips on its shaft at each reversal, towards where the load pulls it, until its screw stops it."""

    joint: int
    bound_rad: float
    share_per_nm: float

    def added_angles(self, load: JointLoad) -> Array:
        """At each reversal a share of the way that is left to the bound, larger under more load."""
        tau, side = load.tau_nm[:, self.joint - 1], load.poses.direction[:, self.joint - 1]
        place, slipped = 0.0, np.zeros(len(tau))
        for row in range(len(tau)):
            if row and side[row] * side[row - 1] < 0.0:
                way = self.bound_rad * np.sign(tau[row]) - place
                place += way * (1.0 - np.exp(-self.share_per_nm * abs(tau[row])))
            slipped[row] = place
        return at_joint(self.joint, slipped, load.tau_nm)


@dataclass(frozen=True)
class ManyPaceJoint(HiddenEffect):
    """Creep with several time constants (written after the tool's effects): polymers have a spectrum of them."""

    joint: int
    compliance_rad_per_nm: float
    constants_s: tuple[float, ...]
    late: float = 0.0

    def added_angles(self, load: JointLoad) -> Array:
        """Equal parts of the compliance at each pace."""
        tau, time = load.tau_nm[:, self.joint - 1], load.poses.time_s
        states = [yielded(tau, time, constant, self.late, False) for constant in self.constants_s]
        return at_joint(self.joint, self.compliance_rad_per_nm * np.mean(states, axis=0), load.tau_nm)


@dataclass(frozen=True)
class PromptReading(HiddenEffect):
    """Creep of a joint that is read a fixed time after each move, whatever the wait before it (written after the tool
    knew a share of the wait)."""

    joint: int
    compliance_rad_per_nm: float
    constant_s: float
    after_s: float

    def added_angles(self, load: JointLoad) -> Array:
        """The pose before is held until the move, the new one for a few seconds."""
        tau, time = load.tau_nm[:, self.joint - 1], load.poses.time_s
        state = tau.copy()
        for row in range(1, len(tau)):
            held = max(time[row] - time[row - 1] - self.after_s, 0.0)
            left = tau[row - 1] + (state[row - 1] - tau[row - 1]) * np.exp(-held / self.constant_s)
            state[row] = tau[row] + (left - tau[row]) * np.exp(-self.after_s / self.constant_s)
        return at_joint(self.joint, self.compliance_rad_per_nm * state, load.tau_nm)
