"""Forces missing from the nominal arm: cable stiffness, errors of the masses and centres of mass."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_math.arm.arm import TOOL, Arm
from lrm_math.effects.base import Amounts, AngleDependentEffect, Effect, Excitation, Parameter
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.statics import WeightChange

CENTRE_OF_MASS = tuple(Parameter(f"com_{axis}_mm", f"error of its centre of mass along {axis}", 0.01) for axis in "xyz")


class CableSpring(AngleDependentEffect):
    """A cable that acts on a joint as a linear spring; its torque c·q0 at angle zero is left to `offsets`."""

    id = "cable_spring"
    cause = "Cables along the arm are stiff; they pull a joint back as it turns away from where they lie slack."
    formula = "torque −c (q − q0) through the joint's compliance"
    source = "linear spring"
    claim = "a cable pulls {place} back with {c_Nm_per_rad}"
    needs = "several levels of the joint"
    parameters = (Parameter("c_Nm_per_rad", "stiffness of the cable", 0.2, lower=0.0),)
    moves = ()

    @property
    def pushes(self) -> tuple[str, ...]:
        """The joint's axis."""
        return (f"{self.place}.theta",)

    def push(self, poses: Poses, p: Sequence[float]) -> Amounts:
        """−c q."""
        return (-p[0] * poses.angle(self.joint),)


class Mass(Effect):
    """Error of a link's mass and centre of mass."""

    id = "mass"
    cause = "A link is heavier than it was weighed (screws, cables, glue), or its centre of mass lies elsewhere."
    formula = "mass + δm, centre of mass + δc in the frame it stands in"
    source = "Conenna 2024, section 4.4"
    claim = "{place} weighs {mass_g} more, its centre of mass is off by {com_x_mm}, {com_y_mm}, {com_z_mm}"
    parameters = (Parameter("mass_g", "error of the mass of the link", 0.03), *CENTRE_OF_MASS)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """link1 … linkN, where some body first loads joint N."""
        loaded = {body.loads_joint for body in arm.bodies}
        return tuple(f"link{i}" for i in range(1, arm.dof + 1) if i in loaded)

    @property
    def weighs(self) -> tuple[int, ...]:
        """The innermost body that loads this joint first."""
        number = int(self.place.removeprefix("link"))
        return (next(i for i, body in enumerate(self.arm.bodies_outwards) if body.loads_joint == number),)

    def weight(self, carried: Number, p: Sequence[float]) -> tuple[WeightChange, ...]:
        """(δm, δc)."""
        return (WeightChange(p[0], (p[1], p[2], p[3])),)


class Payload(Effect):
    """Error of the payload's mass and centre of mass."""

    id = "payload"
    cause = "The load weighs something else than was written down, or its centre of mass is not where it was assumed."
    formula = "mass + δm, centre of mass + δc, in the poses that carry a load"
    source = "Conenna 2024, section 4.4"
    claim = "the load weighs {mass_g} more than written, its centre is off by {com_x_mm}, {com_y_mm}, {com_z_mm}"
    needs = "poses with a load, and poses without or with another one"
    parameters = (Parameter("mass_g", "error of the load's mass", 0.02), *CENTRE_OF_MASS)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The tool, if a body carries the payload."""
        return (TOOL,) if any(body.carries_payload for body in arm.bodies) else ()

    @property
    def weighs(self) -> tuple[int, ...]:
        """Every body that carries payload."""
        return tuple(i for i, body in enumerate(self.arm.bodies_outwards) if body.carries_payload)

    def weight(self, carried: Number, p: Sequence[float]) -> tuple[WeightChange, ...]:
        """The errors, in poses with a load. The body's own mass moves with the load's centre."""
        loaded: Number = float(carried > 0) if isinstance(carried, float) else (carried > 0).astype(np.float64)
        return tuple(WeightChange(p[0] * loaded, (p[1] * loaded, p[2] * loaded, p[3] * loaded)) for _ in self.weighs)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Some pose must carry a load."""
        return None if np.any(excitation.poses.payload > 0) else "no pose carries a load"
