"""Loads that the model does not know or does not weigh right: cables, links, payload."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arm.arm import TOOL, Arm
from lrm_math.effects.base import (
    Amounts,
    Effect,
    Evidence,
    Parameter,
    joint_number,
    needs_levels,
)
from lrm_math.kinematics.chain import Number, chain_of
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.statics import Ballast


@dataclass(frozen=True)
class CableSpring(Effect):
    """A cable along the arm that pulls a joint back to where it is slack."""

    id = "cable_spring"
    cause = "Cables along the arm are stiff; they pull a joint back as it turns away from where they lie slack."
    formula = "torque −c (q − q0) through the joint's compliance"
    source = "linear spring"
    claim = "a cable pulls {place} back with {c_Nm_per_rad}"
    needs = "several levels of the joint"

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every joint."""
        return arm.joint_names

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The cable's stiffness c; the torque c·q0 at angle zero looks like an offset and is left to that."""
        return (Parameter("c_Nm_per_rad", f"stiffness of the cable at {self.place}", 0.2, lower=0.0),)

    @property
    def pushes(self) -> tuple[str, ...]:
        """The joint's axis."""
        return (f"{self.place}.theta",)

    def push(self, poses: Poses, p: Sequence[float]) -> Amounts:
        """−c q."""
        return (-p[0] * poses.angle(joint_number(self.place)),)

    def why_not(self, evidence: Evidence) -> str | None:
        """It needs the joint to move."""
        return needs_levels(evidence, self.place)


@dataclass(frozen=True)
class Mass(Effect):
    """A link that weighs more or less than written, or elsewhere."""

    id = "mass"
    cause = "A link is heavier than it was weighed (screws, cables, glue), or its centre of mass lies elsewhere."
    formula = "mass + δm, centre of mass + δc in the frame it stands in"
    source = "Conenna 2024, section 4.4"
    claim = "{place} weighs {mass_g} more, its centre of mass is off by {com_x_mm}, {com_y_mm}, {com_z_mm}"

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """link1 … linkN, where some body first loads joint N."""
        loaded = {body.loads_joint for body in arm.bodies}
        return tuple(f"link{i}" for i in range(1, arm.dof + 1) if i in loaded)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Mass and centre of mass."""
        place = self.place
        return (
            Parameter("mass_g", f"error of the mass of {place}", 0.03),
            *(Parameter(f"com_{axis}_mm", f"error of its centre of mass along {axis}", 0.01) for axis in "xyz"),
        )

    @property
    def weighs(self) -> tuple[int, ...]:
        """The innermost body that loads this joint first."""
        number = int(self.place.removeprefix("link"))
        bodies = sorted(self.arm.bodies, key=lambda b: (b.frame, not b.near_end))
        return (next(i for i, body in enumerate(bodies) if body.loads_joint == number),)

    def weight(self, carried: Number, p: Sequence[float]) -> tuple[Ballast, ...]:
        """The errors themselves."""
        return (Ballast(p[0], (p[1], p[2], p[3])),)


@dataclass(frozen=True)
class Payload(Effect):
    """A load that weighs more or less than the file says, or hangs elsewhere."""

    id = "payload"
    cause = "The load weighs something else than was written down, or its centre of mass is not where it was assumed."
    formula = "mass + δm, centre of mass + δc, in the poses that carry a load"
    source = "Conenna 2024, section 4.4"
    claim = "the load weighs {mass_g} more than written, its centre is off by {com_x_mm}, {com_y_mm}, {com_z_mm}"
    needs = "poses with a load, and poses without or with another one"

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The tool, if a body carries the payload."""
        return (TOOL,) if any(body.carries_payload for body in arm.bodies) else ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Mass and centre of mass."""
        return (
            Parameter("mass_g", "error of the load's mass", 0.02),
            *(Parameter(f"com_{axis}_mm", f"error of its centre of mass along {axis}", 0.01) for axis in "xyz"),
        )

    @property
    def weighs(self) -> tuple[int, ...]:
        """Every body that carries payload."""
        return tuple(i for i, body in enumerate(chain_of(self.arm).bodies) if body.carries_payload)

    def weight(self, carried: Number, p: Sequence[float]) -> tuple[Ballast, ...]:
        """The errors, in poses with a load. The body's own mass moves with the load's centre."""
        loaded: Number = float(carried > 0) if isinstance(carried, float) else (carried > 0).astype(np.float64)
        return tuple(Ballast(p[0] * loaded, (p[1] * loaded, p[2] * loaded, p[3] * loaded)) for _ in self.weighs)

    def why_not(self, evidence: Evidence) -> str | None:
        """It needs loads."""
        return None if np.any(evidence.poses.payload > 0) else "no pose carries a load"
