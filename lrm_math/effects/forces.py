"""Forces missing from the nominal arm: cable stiffness, errors of the masses and centres of mass."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from lrm_math.arm.arm import TOOL, Arm
from lrm_math.effects.base import (
    Amounts,
    AngleDependentEffect,
    Description,
    Excitation,
    Extrapolation,
    LinearEffect,
    Parameter,
    separately,
)
from lrm_math.effects.targets import BODY_AMOUNTS
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses

CENTRE_OF_MASS = tuple(Parameter(f"com_{axis}_mm", f"error of its centre of mass along {axis}", 0.01) for axis in "xyz")
CENTRE_CLAIM = "its centre lies {com_x_mm}, {com_y_mm}, {com_z_mm} further along x, y, z"


class CableSpring(AngleDependentEffect, LinearEffect):
    """A cable that acts on a joint as a linear spring; its torque c·q0 at angle zero is left to `offsets`."""

    id = "cable_spring"
    about = Description(
        cause="Cables along the arm are stiff; they pull a joint back as it turns away from where they lie slack.",
        formula="torque −c (q − q0) through the joint's compliance",
        source="linear spring",
        claim="a cable pulls {place} back with {c_Nm_per_rad}",
        needs="several levels of the joint",
    )
    extrapolation = Extrapolation.PROPORTIONAL
    parameters = (Parameter("c_Nm_per_rad", "stiffness of the cable", 0.2, lower=0.0),)

    @property
    def targets(self) -> tuple[str, ...]:
        """The torque on the joint's axis."""
        return (f"{self.place}.theta.load",)

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """−q."""
        return ((-poses.angle(self.joint),),)


class _BodyError(LinearEffect):
    """Errors of the mass and centre of mass of some bodies, the same of each."""

    depends_on = ()
    extrapolation = Extrapolation.PROPORTIONAL

    @property
    @abstractmethod
    def bodies(self) -> tuple[int, ...]:
        """Numbers of the bodies in `arm.bodies_outwards`."""

    @property
    def targets(self) -> tuple[str, ...]:
        """Mass and centre of mass of each body."""
        return tuple(f"body{body}.{name}" for body in self.bodies for name in BODY_AMOUNTS)

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """One in the poses where the error acts, for each body alike."""
        return tuple(row * len(self.bodies) for row in separately([(self.acts(poses),)] * len(BODY_AMOUNTS)))

    def acts(self, poses: Poses) -> Number:
        """1 in poses where the error acts, else 0."""
        return 1.0


class Mass(_BodyError):
    """Error of a link's mass and centre of mass."""

    id = "mass"
    about = Description(
        cause="A link is heavier than it was weighed (screws, cables, glue), or its centre of mass lies elsewhere.",
        formula="mass + δm, centre of mass + δc in the frame it stands in",
        source="Conenna 2024, section 4.4",
        claim="{place} weighs {mass_g} more than the arm file says, " + CENTRE_CLAIM,
    )
    parameters = (Parameter("mass_g", "error of the mass of the link", 0.03), *CENTRE_OF_MASS)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """link1 … linkN, where some body first loads joint N."""
        loaded = {body.loads_joint for body in arm.bodies}
        return tuple(f"link{i}" for i in range(1, arm.dof + 1) if i in loaded)

    @property
    def bodies(self) -> tuple[int, ...]:
        """The innermost body that loads this joint first."""
        number = int(self.place.removeprefix("link"))
        return (next(i for i, body in enumerate(self.arm.bodies_outwards) if body.loads_joint == number),)


class Payload(_BodyError):
    """Error of the payload's mass and centre of mass."""

    id = "payload"
    about = Description(
        cause=(
            "The load weighs something else than was written down, or its centre of mass is not where it was assumed."
        ),
        formula="mass + δm, centre of mass + δc, in the poses that carry a load",
        source="Conenna 2024, section 4.4",
        claim="the load weighs {mass_g} more than is written, " + CENTRE_CLAIM,
        needs="poses with a load, and poses without or with another one",
    )
    parameters = (Parameter("mass_g", "error of the load's mass", 0.02), *CENTRE_OF_MASS)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The tool, if a body carries the payload."""
        return (TOOL,) if any(body.carries_payload for body in arm.bodies) else ()

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Some pose must carry a load."""
        return None if np.any(excitation.poses.payload > 0) else "no pose carries a load"

    @property
    def bodies(self) -> tuple[int, ...]:
        """Every body that carries payload; its own mass moves with the load's centre."""
        return tuple(i for i, body in enumerate(self.arm.bodies_outwards) if body.carries_payload)

    def acts(self, poses: Poses) -> Number:
        """1 in poses with a load, else 0."""
        carried = poses.carried
        return float(carried > 0) if isinstance(carried, float) else (carried > 0).astype(np.float64)
