"""Forces missing from the nominal arm: cable stiffness, errors of the masses and of the direction of gravity."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from lrm_math.arm.arm import BASE, TOOL, Arm
from lrm_math.effects.base import (
    Amounts,
    AngleDependentEffect,
    Description,
    Effect,
    Excitation,
    Extrapolation,
    LinearEffect,
    Parameter,
    separately,
)
from lrm_math.effects.targets import BODY_AMOUNTS, GRAVITY
from lrm_math.kinematics.chain import PLANE, Number, rotate, trig_of
from lrm_math.kinematics.poses import Poses

AXES = "xyz"
LEAN = 0.03  # rad: how far a table, a floor or a rover is out of level
CENTRE_OF_MASS = tuple(Parameter(f"com_{axis}_mm", f"error of its centre of mass along {axis}", 0.01) for axis in "xyz")
CENTRE_CLAIM = "its centre is off by {com_x_mm:along|against} x, {com_y_mm:along|against} y, {com_z_mm:along|against} z"


class CableSpring(AngleDependentEffect, LinearEffect):
    """A cable that acts on a joint as a linear spring; its torque c·q0 at angle zero is left to `offsets`."""

    id = "cable_spring"
    about = Description(
        cause="Cables along the arm are stiff; they pull a joint back as it turns away from where they lie slack.",
        formula="torque −c (q − q0) through the joint's compliance",
        source="linear spring",
        claim="a cable pulls {place} back with {c_Nm_per_rad}",
        needs="several angles of the joint",
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
        claim="{place} weighs {mass_g:more|less} than the arm file says, " + CENTRE_CLAIM,
    )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Mass and centre of mass; a link is not lighter than nothing, nor twice as heavy as it was weighed."""
        mass = self.arm.bodies_outwards[self.bodies[0]].mass or None
        return (Parameter("mass_g", "error of the mass of the link", 0.03, usual=mass, largest=mass), *CENTRE_OF_MASS)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """link1 … linkN, where some body first loads joint N."""
        loaded = {body.loads_joint for body in arm.bodies}
        return tuple(f"link{i}" for i in range(1, len(arm.links) + 1) if i in loaded)

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
        claim="the load weighs {mass_g:more|less} than is stated, " + CENTRE_CLAIM,
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


class Gravity(Effect):
    """Direction of gravity in the frame of measurement: two angles, about the axes most square to the stated one.

    Where poses state gravity's direction, that is known and the effect adds nothing.
    """

    id = "gravity"
    about = Description(
        cause="The base does not stand level: gravity leans in the frame that positions are measured in.",
        formula="g = R_j(b) R_i(a) (gravity of the arm file), i and j the axes x, y of an arm that stands or hangs",
        source="gravity as a vector g0 in the base frame: Siciliano et al. 2009, section 7.1",
        claim="the base is not level: gravity leans and bends the arm",
        needs="poses that bend the arm to several sides, best with a load",
    )
    depends_on = ()
    extrapolation = Extrapolation.PROPORTIONAL
    targets = tuple(f"{GRAVITY}{axis}" for axis in AXES)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The base."""
        return (BASE,)

    @cached_property
    def axes(self) -> tuple[int, int]:
        """Numbers of the axes x, y, z that are most square to the gravity of the arm file."""
        down = max(range(len(AXES)), key=lambda axis: abs(self.arm.gravity[axis]))
        return (down + 1) % len(AXES), (down + 2) % len(AXES)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The angle about either axis."""
        return tuple(Parameter(f"{AXES[k]}_rad", f"rotation of gravity about {AXES[k]}", LEAN) for k in self.axes)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Change of each component of the arm file's gravity by the rotations (m/s²)."""
        if poses.gravity is not None:
            return (0.0,) * len(AXES)
        g: list[Number] = list(self.arm.gravity)
        for axis, angle in zip(self.axes, p, strict=True):
            rotate(g, PLANE[axis], trig_of(angle))
        return tuple(turned - stated for turned, stated in zip(g, self.arm.gravity, strict=True))

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Gravity's direction must not be known."""
        gravity_known = excitation.poses.gravity is not None
        return "gravity's direction was measured at every pose (gx, gy, gz or roll, pitch)" if gravity_known else None
