"""Hidden effects of links, bearings and base, whose ends turn or shift under load. In m, rad, Nm, N.

*Right* names what leads to the part that is at fault, where the tool has no effect of that kind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm_description import Vector3
from .hidden_effect import BaseError, EndLoad, LinkError, past
from .hidden_memory import yielded
from .screws import Array

ACROSS, ALONG = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
"""Of z of the end frame, the next joint's axis."""


@dataclass(frozen=True)
class LinkBending(LinkError):
    """A link as an Euler-Bernoulli cantilever loaded at its end, in both planes.

    End rotation M l / EI + F l^2 / 2 EI, end deflection M l^2 / 2 EI + F l^3 / 3 EI. along and across: unit vectors in
    the link's end frame, the beam's direction and its first transverse axis. stiffness_nm2: flexural rigidity E I
    about the first and the second transverse axis.
    """

    length_m: float
    stiffness_nm2: tuple[float, float]
    along: Vector3 = (0.0, 0.0, 1.0)
    across: Vector3 = (1.0, 0.0, 0.0)

    def link_deflection(self, load: EndLoad) -> Array:
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


@dataclass(frozen=True)
class HingedLink(LinkError):
    """A link that gives way at one place, behind_m before its end along -z of its end frame: near its root, its end.

    compliance_rad_per_nm: about x and y of the end frame. The moment is that at the hinge.
    """

    behind_m: float
    compliance_rad_per_nm: tuple[float, float]

    def turn(self, load: EndLoad) -> Array:
        moment = load.moment_nm + np.cross(self._lever, load.force_n)
        return np.asarray(moment * np.array([*self.compliance_rad_per_nm, 0.0]))

    def shift(self, load: EndLoad) -> Array:
        return np.cross(self.turn(load), self._lever)

    @property
    def _lever(self) -> Array:
        return np.array([0.0, 0.0, self.behind_m])


@dataclass(frozen=True)
class CrackedLink(LinkError):
    """A crack across a link that opens under a positive moment about x, and closes under a negative one."""

    compliance_rad_per_nm: float

    def turn(self, load: EndLoad) -> Array:
        return np.asarray(np.maximum(load.moment_nm, 0.0) * np.array([self.compliance_rad_per_nm, 0.0, 0.0]))


@dataclass(frozen=True)
class LogarithmicCreep(LinkError):
    """Plastic that gives way across the link with the logarithm of time, from its first load on."""

    compliance_rad_per_nm: float
    after_s: float

    def turn(self, load: EndLoad) -> Array:
        grown = self.compliance_rad_per_nm * np.log1p(load.poses.time_s / self.after_s)
        return np.asarray(grown[:, None] * load.moment_nm * ACROSS)


@dataclass(frozen=True)
class ShearingPlates(LinkError):
    """A link of two thin plates that shifts sideways as a parallelogram, without turning. Right: lateral_compliance."""

    shift_m_per_n: float

    def shift(self, load: EndLoad) -> Array:
        return np.asarray(self.shift_m_per_n * load.force_n * np.array([1.0, 0.0, 0.0]))


@dataclass(frozen=True)
class SwellingLink(LinkError):
    """A link of nylon that takes up water while it is measured, and grows. No name says so."""

    growth_m: Vector3

    def shift(self, load: EndLoad) -> Array:
        time = load.poses.time_s
        return np.asarray(np.sqrt(time / time.max())[:, None] * np.array(self.growth_m))


@dataclass(frozen=True)
class TelescopingTube(LinkError):
    """A tube that slips into its clamp by and by, whenever weight presses along it. No name says so.

    shift_m: in all, had it always been pressed by 3 N.
    """

    shift_m: float

    def shift(self, load: EndLoad) -> Array:
        pressed = np.maximum(-load.force_n[:, 2], 0.0) / 3.0
        slipped = self.shift_m * past(pressed) / len(pressed)
        return np.asarray(-slipped[:, None] * ALONG)


@dataclass(frozen=True)
class TiltingBearing(LinkError):
    """A joint's bearing with clearance, at the end of the link before it: it tilts across the axis by up to tilt_rad.

    The tilt is along the moment across the axis, and saturates beyond softness_nm.
    """

    tilt_rad: float
    softness_nm: float

    def turn(self, load: EndLoad) -> Array:
        across = load.moment_nm * ACROSS
        size = np.sqrt((across**2).sum(axis=1) + self.softness_nm**2)
        return np.asarray(self.tilt_rad * across / size[:, None])


@dataclass(frozen=True)
class RadialFloat(LinkError):
    """Radial clearance of a joint's bearing, at the end of the link before it: across its axis by up to float_m."""

    float_m: float
    softness_n: float

    def shift(self, load: EndLoad) -> Array:
        across = load.force_n * ACROSS
        size = np.sqrt((across**2).sum(axis=1) + self.softness_n**2)
        return np.asarray(self.float_m * across / size[:, None])


@dataclass(frozen=True)
class AxialFloat(LinkError):
    """Axial play of a joint, at the end of the link before it: along its axis by up to float_m either way.

    The collar that ends it gives way by collar_m_per_n.
    """

    float_m: float
    softness_n: float
    collar_m_per_n: float = 0.0

    def shift(self, load: EndLoad) -> Array:
        along = load.force_n[:, 2]
        return np.asarray(
            (self.float_m * np.tanh(along / self.softness_n) + self.collar_m_per_n * along)[:, None] * ALONG
        )


@dataclass(frozen=True)
class HelicalThrust(LinkError):
    """Helical gears that press the shaft along its axis, to the side of the torque. Right: axial_play of the joint."""

    float_m: float
    softness_nm: float

    def shift(self, load: EndLoad) -> Array:
        along = self.float_m * np.tanh(load.moment_nm[:, 2] / self.softness_nm)
        return np.asarray(along[:, None] * ALONG)


@dataclass(frozen=True)
class GlareSpot(LinkError):
    """A glossy ball seen from above: its bright spot moves to the side of the lamp on the flange. No name says so."""

    size_m: float

    def shift(self, load: EndLoad) -> Array:
        down = load.force_n / np.linalg.norm(load.force_n, axis=1, keepdims=True)
        return np.asarray(self.size_m * (ALONG - down[:, 2:] * down))


@dataclass(frozen=True)
class MarkerOnJaw(LinkError):
    """A target on the gripper's moving jaw, which stands elsewhere when it holds the load. No name says so."""

    shift_m: Vector3

    def shift(self, load: EndLoad) -> Array:
        return np.asarray((load.poses.payload_kg > 0.0)[:, None] * np.array(self.shift_m))


@dataclass(frozen=True)
class LooseBase(LinkError):
    """Screws of the base with clearance: it leans by tilt_rad about y to the side of the moment."""

    tilt_rad: float

    def turn(self, load: EndLoad) -> Array:
        return np.asarray(np.sign(load.moment_nm) * np.array([0.0, self.tilt_rad, 0.0]))


@dataclass(frozen=True)
class StiffeningTable(LinkError):
    """A table that gives way most under small moments: by the root of the moment (Nm)."""

    turn_rad_per_root_nm: float

    def turn(self, load: EndLoad) -> Array:
        across = load.moment_nm * ACROSS
        return np.asarray(self.turn_rad_per_root_nm * np.sign(across) * np.sqrt(np.abs(across)))


@dataclass(frozen=True)
class BaseRocking(BaseError):
    """Compliance of the base about one more axis, a unit vector in its frame."""

    compliance_rad_per_nm: float
    axis: Vector3

    def turn(self, load: EndLoad) -> Array:
        turn = self.compliance_rad_per_nm * (load.moment_nm @ np.array(self.axis))
        return np.asarray(turn[:, None] * np.array(self.axis))


@dataclass(frozen=True)
class LiftingBase(BaseError):
    """A base that lifts off its plate: about `axis` (in its frame) it gives way only beyond a moment, on one side.

    compliance_rad_per_nm beyond lift_nm, with a rounded corner of corner_nm.
    """

    axis: Vector3
    compliance_rad_per_nm: float
    lift_nm: float
    corner_nm: float

    def turn(self, load: EndLoad) -> Array:
        beyond = load.moment_nm @ np.array(self.axis) - self.lift_nm
        turn = self.compliance_rad_per_nm * 0.5 * (beyond + np.hypot(beyond, self.corner_nm))
        return np.asarray(turn[:, None] * np.array(self.axis))


@dataclass(frozen=True)
class BaseWarmUp(BaseError):
    """Warm-up drift of the base, which the servos heat: two different first-order lags in series.

    turn_rad: final rotation vector in the base frame; constants_s: time constants of servos and base.
    """

    turn_rad: Vector3
    constants_s: tuple[float, float]

    def turn(self, load: EndLoad) -> Array:
        (fast, slow), t = self.constants_s, load.poses.time_s
        warmth = 1.0 - (slow * np.exp(-t / slow) - fast * np.exp(-t / fast)) / (slow - fast)
        return np.asarray(warmth[:, None] * np.array(self.turn_rad))


@dataclass(frozen=True)
class WobblingTurntable(BaseError):
    """A turntable bearing under joint 1 with two high spots: the axis nods twice a turn. No name says so."""

    tilt_rad: float

    def turn(self, load: EndLoad) -> Array:
        twice = 2.0 * load.poses.q_rad[:, 0]
        return self.tilt_rad * np.stack([np.cos(twice), np.sin(twice), np.zeros_like(twice)], axis=1)


@dataclass(frozen=True)
class WalkingBase(BaseError):
    """A base that is not screwed down: each wide swing of joint 1 turns it a little, less against its cable.

    Right: whatever moves the base, or joint 1 about the same axis, with time.
    """

    share: float
    from_rad: float

    def turn(self, load: EndLoad) -> Array:
        swing = np.diff(load.poses.q_rad[:, 0], prepend=0.0)
        slips = self.share * np.sign(swing) * np.maximum(np.abs(swing) - self.from_rad, 0.0)
        return np.asarray(-np.cumsum(np.where(slips > 0.0, slips, 0.85 * slips))[:, None] * ALONG)


@dataclass(frozen=True)
class LevellingTable(BaseError):
    """A table on air springs that level it again within some poses: it tilts by what the moment has changed.

    Right: base_compliance.
    """

    turn_rad_per_nm: float
    share_per_pose: float

    def turn(self, load: EndLoad) -> Array:
        levelled = np.zeros_like(load.moment_nm)
        for row in range(1, len(levelled)):
            before = levelled[row - 1]
            levelled[row] = before + self.share_per_pose * (load.moment_nm[row - 1] - before)
        return np.asarray(self.turn_rad_per_nm * (load.moment_nm - levelled) * ACROSS)


@dataclass(frozen=True)
class ViscoelasticBase(BaseError):
    """A base that tilts slowly under the moment on it, about x and y of the world.

    On this arm these are not those of the base's own frame, which leans by 60 degrees.
    """

    compliance_rad_per_nm: tuple[float, float]
    constant_s: float
    late: float = 0.0

    def turn(self, load: EndLoad) -> Array:
        to_world = self._rotation(load)
        turn, moment = np.zeros_like(load.force_n), load.moment_nm @ to_world.T
        for axis, compliance in enumerate(self.compliance_rad_per_nm):
            followed = yielded(moment[:, axis], load.poses.time_s, self.constant_s, self.late, False)
            turn[:, axis] = compliance * followed
        return turn @ to_world

    @staticmethod
    def _rotation(load: EndLoad) -> Array:
        """(3, 3), from the frame of the base as drawn to the world's."""
        (cx, cy, cz), (sx, sy, sz) = np.cos(load.poses.arm.base.angles_rad), np.sin(load.poses.arm.base.angles_rad)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(about_x @ about_y @ about_z)


@dataclass(frozen=True)
class RockingFeet(BaseError):
    """A base on feet of unequal length: about an axis (unit vector in its frame) it tips to the side of the moment.

    tilt_rad: to either side; softness_nm: moment at which three quarters of it are reached.
    """

    axis: Vector3
    tilt_rad: float
    softness_nm: float

    def turn(self, load: EndLoad) -> Array:
        axis = np.array(self.axis)
        turn = self.tilt_rad * np.tanh(load.moment_nm @ axis / self.softness_nm)
        return np.asarray(turn[:, None] * axis)
