"""Hidden effects of bodies: errors of their masses and centres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arm_description import Vector3
from .generate import nominal_tip
from .hidden_effect import CommandedPoses, HiddenEffect
from .screws import Array


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


@dataclass(frozen=True)
class UnstatedPayload(HiddenEffect):
    """A load that is heavier than stated from the second session on."""

    mass_kg: float

    def added_masses(self, poses: CommandedPoses) -> Array:
        masses = super().added_masses(poses)
        masses[:, -1] = self.mass_kg * (poses.session > poses.session.min())
        return masses


@dataclass(frozen=True)
class HangingHose(HiddenEffect):
    """A hose from the floor to the gripper: the higher the tip, the more of it hangs there.

    Right: mass of a last link, as a link is heavier than it was weighed, or payload.
    """

    mass_kg_per_m: float

    def added_masses(self, poses: CommandedPoses) -> Array:
        masses = super().added_masses(poses)
        masses[:, -1] = self.mass_kg_per_m * np.maximum(nominal_tip(poses.arm, poses.q_rad)[:, 2], 0.0)
        return masses
