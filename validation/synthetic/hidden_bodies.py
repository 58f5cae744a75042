"""Hidden effects of bodies: mass errors, flexible links and base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arm_description import Vector3
from .hidden_effect import CommandedPoses, EndLoad, HiddenEffect
from .screws import Array


@dataclass(frozen=True)
class LinkBending(HiddenEffect):
    """A link as an Euler-Bernoulli cantilever loaded at its end.

    along and across: unit vectors in the link's end frame, the beam's direction and its first transverse axis.
    stiffness_nm2: flexural rigidity E I about the first and the second transverse axis.
    """

    link: int
    length_m: float
    stiffness_nm2: tuple[float, float]
    along: Vector3 = (0.0, 0.0, 1.0)
    across: Vector3 = (1.0, 0.0, 0.0)

    def flexible_links(self) -> tuple[int, ...]:
        return (self.link,)

    def link_deflection(self, load: EndLoad) -> Array:
        """End rotation M l / EI + F l^2 / 2 EI and end deflection M l^2 / 2 EI + F l^3 / 3 EI, in both planes."""
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
class BaseRocking(HiddenEffect):
    """Compliance of the base about one more axis, a unit vector in its frame."""

    compliance_rad_per_nm: float
    axis: Vector3

    def flexible_links(self) -> tuple[int, ...]:
        return (0,)

    def link_deflection(self, load: EndLoad) -> Array:
        turn = self.compliance_rad_per_nm * (load.moment_nm @ np.array(self.axis))
        return np.hstack([turn[:, None] * np.array(self.axis), np.zeros((len(turn), 3))])


@dataclass(frozen=True)
class BaseWarmUp(HiddenEffect):
    """Warm-up drift of the base, which the servos heat: two different first-order lags in series.

    turn_rad: final rotation vector in the base frame; constants_s: time constants of servos and base.
    """

    turn_rad: Vector3
    constants_s: tuple[float, float]

    def flexible_links(self) -> tuple[int, ...]:
        return (0,)

    def link_deflection(self, load: EndLoad) -> Array:
        (fast, slow), t = self.constants_s, load.poses.time_s
        warmth = 1.0 - (slow * np.exp(-t / slow) - fast * np.exp(-t / fast)) / (slow - fast)
        return np.hstack([warmth[:, None] * np.array(self.turn_rad), np.zeros((len(t), 3))])


@dataclass(frozen=True)
class WrongLoad(HiddenEffect):
    """Error of the stated payload, in loaded poses: extra_kg of mass, and shift_m of its centre of mass.

    shift_m: in the frame of the body that carries the payload.
    """

    extra_kg: float
    shift_m: Vector3 = (0.0, 0.0, 0.0)

    def added_masses(self, poses: CommandedPoses) -> Array:
        masses = super().added_masses(poses)
        masses[:, self._carriers(poses)] = np.where(poses.payload_kg > 0.0, self.extra_kg, 0.0)[:, None]
        return masses

    def added_com_shifts(self, poses: CommandedPoses) -> Array:
        """Shift of the common centre of mass of carrier and payload."""
        load = np.where(poses.payload_kg > 0.0, poses.payload_kg + self.extra_kg, 0.0)
        own = np.array([body.mass_kg for body in poses.arm.bodies])
        share = load[:, None] / (own + load[:, None]) * self._carriers(poses)
        return np.asarray(share[..., None] * np.array(self.shift_m))

    def _carriers(self, poses: CommandedPoses) -> NDArray[np.bool_]:
        return np.array([body.carries_payload for body in poses.arm.bodies], dtype=bool)


@dataclass(frozen=True)
class WrongBody(HiddenEffect):
    """Error of a named body: a share of its mass, and shift_m of its centre of mass in its frame."""

    body: str
    share: float
    shift_m: Vector3 = (0.0, 0.0, 0.0)

    def added_masses(self, poses: CommandedPoses) -> Array:
        mass = [self.share * body.mass_kg if body.name == self.body else 0.0 for body in poses.arm.bodies]
        return np.asarray(super().added_masses(poses) + np.array(mass))

    def added_com_shifts(self, poses: CommandedPoses) -> Array:
        """Shifts in all poses. Not for the body that carries the payload, whose centre would shift too."""
        shifts = super().added_com_shifts(poses)
        shifts[:, [body.name == self.body for body in poses.arm.bodies]] = self.shift_m
        return shifts
