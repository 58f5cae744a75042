"""Hidden effects of bodies: what they weigh, and how they bend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .hidden import Effect, EndLoad, Situation
from .rig import Vector
from .screws import Array


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


@dataclass(frozen=True)
class BaseRocking(Effect):
    """A base that gives way about one more axis, a unit vector in its frame, to the moment about that axis."""

    compliance_rad_per_nm: float
    axis: Vector

    def bent_links(self) -> tuple[int, ...]:
        """The base."""
        return (0,)

    def link_bend(self, load: EndLoad) -> Array:
        """Rotation about the axis by compliance times moment; nothing is shifted."""
        if load.link != 0:
            return super().link_bend(load)
        turn = self.compliance_rad_per_nm * (load.moment_nm @ np.array(self.axis))
        return np.hstack([turn[:, None] * np.array(self.axis), np.zeros((len(turn), 3))])


@dataclass(frozen=True)
class WrongLoad(Effect):
    """A load other than the file says, wherever there is one: heavier by extra_kg, its centre off by shift_m.

    shift_m: in the frame of the body that carries the load.
    """

    extra_kg: float
    shift_m: Vector = (0.0, 0.0, 0.0)

    def added_masses(self, now: Situation) -> Array:
        """Only in loaded poses."""
        masses = super().added_masses(now)
        masses[:, self._carriers(now)] = np.where(now.payload_kg > 0.0, self.extra_kg, 0.0)[:, None]
        return masses

    def added_shifts(self, now: Situation) -> Array:
        """The carrier keeps its centre; with the load's off, their common one is off by the load's share."""
        load = np.where(now.payload_kg > 0.0, now.payload_kg + self.extra_kg, 0.0)
        own = np.array([body.mass_kg for body in now.rig.bodies])
        share = load[:, None] / (own + load[:, None]) * self._carriers(now)
        return np.asarray(share[..., None] * np.array(self.shift_m))

    def _carriers(self, now: Situation) -> NDArray[np.bool_]:
        return np.array([body.carries_payload for body in now.rig.bodies], dtype=bool)


@dataclass(frozen=True)
class WrongBody(Effect):
    """A body other than described, by name: heavier by a share of its mass, its centre off by shift_m in its frame."""

    body: str
    share: float
    shift_m: Vector = (0.0, 0.0, 0.0)

    def added_masses(self, now: Situation) -> Array:
        """In all poses."""
        mass = [self.share * body.mass_kg if body.name == self.body else 0.0 for body in now.rig.bodies]
        return np.asarray(super().added_masses(now) + np.array(mass))

    def added_shifts(self, now: Situation) -> Array:
        """In all poses. Not meant for a body that carries the payload: that would move along."""
        shifts = super().added_shifts(now)
        shifts[:, [body.name == self.body for body in now.rig.bodies]] = self.shift_m
        return shifts
