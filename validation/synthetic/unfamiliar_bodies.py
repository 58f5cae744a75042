"""Hidden effects of links, bearings and base in forms that the fitted model does not have: the second catalogue."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm_description import Vector3
from .hidden_effect import EndLoad, HiddenEffect
from .screws import Array


@dataclass(frozen=True)
class HingedLink(HiddenEffect):
    """A link that gives way at one place, behind_m before its end along -z of its end frame: near its root, its end.

    compliance_rad_per_nm: about x and y of the end frame.
    """

    link: int
    behind_m: float
    compliance_rad_per_nm: tuple[float, float]

    def flexible_links(self) -> tuple[int, ...]:
        return (self.link,)

    def link_deflection(self, load: EndLoad) -> Array:
        """The turn that the moment at the hinge makes, and the shift of the end that follows from it."""
        arm = np.array([0.0, 0.0, self.behind_m])
        moment = load.moment_nm + np.cross(arm, load.force_n)
        turn = moment * np.array([*self.compliance_rad_per_nm, 0.0])
        return np.hstack([turn, np.cross(turn, arm)])


@dataclass(frozen=True)
class TiltingBearing(HiddenEffect):
    """A joint's bearing with clearance, at the end of the link before it: it tilts across the axis by up to tilt_rad.

    The tilt is along the moment across the axis (z of the end frame), and saturates beyond softness_nm.
    """

    link: int
    tilt_rad: float
    softness_nm: float

    def flexible_links(self) -> tuple[int, ...]:
        return (self.link,)

    def link_deflection(self, load: EndLoad) -> Array:
        across = load.moment_nm * np.array([1.0, 1.0, 0.0])
        size = np.sqrt((across**2).sum(axis=1) + self.softness_nm**2)
        return np.hstack([self.tilt_rad * across / size[:, None], np.zeros_like(across)])


@dataclass(frozen=True)
class AxialFloat(HiddenEffect):
    """Axial play of a joint, at the end of the link before it: along its axis by up to float_m either way.

    The collar that ends it gives way by collar_m_per_n.
    """

    link: int
    float_m: float
    softness_n: float
    collar_m_per_n: float = 0.0

    def flexible_links(self) -> tuple[int, ...]:
        return (self.link,)

    def link_deflection(self, load: EndLoad) -> Array:
        along, shift = load.force_n[:, 2], np.zeros((len(load.force_n), 6))
        shift[:, 5] = self.float_m * np.tanh(along / self.softness_n) + self.collar_m_per_n * along
        return shift


@dataclass(frozen=True)
class RadialFloat(HiddenEffect):
    """Radial clearance of a joint's bearing, at the end of the link before it: across its axis by up to float_m."""

    link: int
    float_m: float
    softness_n: float

    def flexible_links(self) -> tuple[int, ...]:
        return (self.link,)

    def link_deflection(self, load: EndLoad) -> Array:
        across = load.force_n * np.array([1.0, 1.0, 0.0])
        size = np.sqrt((across**2).sum(axis=1) + self.softness_n**2)
        return np.hstack([np.zeros_like(across), self.float_m * across / size[:, None]])


@dataclass(frozen=True)
class LiftingBase(HiddenEffect):
    """A base that lifts off its plate: about `axis` (in its frame) it gives way only beyond a moment, on one side.

    compliance_rad_per_nm beyond lift_nm, with a rounded corner of corner_nm.
    """

    axis: Vector3
    compliance_rad_per_nm: float
    lift_nm: float
    corner_nm: float

    def flexible_links(self) -> tuple[int, ...]:
        return (0,)

    def link_deflection(self, load: EndLoad) -> Array:
        beyond = load.moment_nm @ np.array(self.axis) - self.lift_nm
        turn = self.compliance_rad_per_nm * 0.5 * (beyond + np.hypot(beyond, self.corner_nm))
        return np.hstack([turn[:, None] * np.array(self.axis), np.zeros((len(turn), 3))])
