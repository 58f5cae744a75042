"""Level 3: elastic deflection of joints, links and base under gravity (thesis section 4.3, 7 parameters)."""

from __future__ import annotations

from functools import cached_property

from lrm_math.arm.arm import BASE, Arm, TypicalSizes
from lrm_math.effects.base import (
    Amounts,
    Description,
    Excitation,
    Extrapolation,
    LinearEffect,
    LoadedJointEffect,
    Parameter,
    separately,
)
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import magnitude


class Spring(LinearEffect):
    """Linear springs of some slots, one parameter each: δ = k · load."""

    depends_on = ()
    extrapolation = Extrapolation.PROPORTIONAL

    @property
    def load_slots(self) -> tuple[str, ...]:
        """The loads on the slots that it moves."""
        return self.targets

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """The load on each slot."""
        return separately([(load,) for load in tau])


class Compliance(Spring):
    """A linear torsion spring in one joint, or in the base about its y axis."""

    id = "compliance"
    about = Description(
        cause="Servo, gears and plastic around a joint twist under the torque that they hold, like a spring.",
        formula="δq = k τ; the base: δβ = k τ about its y axis",
        source="Conenna 2024, section 4.3; Kamali et al. 2016",
        claim="{place} gives way by {k_rad_per_Nm}",
    )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One, in a joint as large as the arm's make suggests."""
        sizes = TypicalSizes() if self.place == BASE else self.arm.typical_sizes
        return (Parameter("k_rad_per_Nm", "torsional compliance", sizes.compliance, lower=0.0),)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The base and every joint, with a motor or without."""
        return (BASE, *arm.link_places)

    @property
    def targets(self) -> tuple[str, ...]:
        """The joint's angle, or the base's tilt about y."""
        return ("base.beta",) if self.place == BASE else (f"{self.place}.theta",)


class ServoDroop(Spring, LoadedJointEffect):
    """The yield of a servo with a proportional controller; statically the same as a compliant joint."""

    id = "servo_droop"
    about = Description(
        cause=(
            "A servo holds its angle like a spring: under load its shaft stands off the command, and its encoder reads "
            "it."
        ),
        formula="δq = k τ, before the encoder; `compliance` is what gives way behind it",
        source="static error of proportional control (Franklin, Powell & Emami-Naeini, section 4.2)",
        claim="the servo of {place} yields by {k_rad_per_Nm} before its encoder",
        needs="joint feedback (q1_meas_deg …); without it, it is the same as compliance",
    )
    parameters = (Parameter("k_rad_per_Nm", "compliance of the servo's control", 0.1, lower=0.0),)

    @property
    def targets(self) -> tuple[str, ...]:
        """The servo's shaft."""
        return (f"{self.place}.servo",)

    @property
    def load_slots(self) -> tuple[str, ...]:
        """The joint's torque."""
        return (f"{self.place}.theta",)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The joint's encoder must have been read."""
        if excitation.feedback:
            return None
        return "without joint feedback (q1_meas_deg …) it is the same as the joint's compliance: one class"


class LateralCompliance(Spring):
    """Bending of a link about the x and y of its far frame, at half its length (virtual joint model)."""

    id = "lateral_compliance"
    about = Description(
        cause="A printed link bends sideways under the moment that runs through it, not only its joint twists.",
        formula="rotation of the link about x and y: k_x M_x, k_y M_y",
        source="rotational virtual springs as in Klimchik et al. 2014; Conenna 2024 leaves them out (section 4.3)",
        claim="{place} bends by {k_x_rad_per_Nm} about its x and {k_y_rad_per_Nm} about its y",
    )
    parameters = (
        Parameter("k_x_rad_per_Nm", "bending of the link about its x", 0.05, lower=0.0),
        Parameter("k_y_rad_per_Nm", "bending of the link about its y", 0.05, lower=0.0),
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every link that carries another one."""
        return tuple(f"link{i}" for i in range(1, len(arm.links)))

    @property
    def targets(self) -> tuple[str, ...]:
        """The link's two bending angles."""
        return (f"{self.place}.x", f"{self.place}.y")


class BendingEnds(Spring):
    """Bending of a link along its length: hinges at its near and far end, beside that at its middle.

    The far end is the bearing of the next joint. A compliance at any one point along the link equals springs at both
    ends and the middle whose stiffness weights interpolate quadratically, so the three stand for a bend anywhere.
    """

    id = "bending_ends"
    variant_of = ("lateral_compliance",)
    about = Description(
        cause="A link bends most where it is thinnest, or its bearing tilts: at one end rather than at its middle.",
        formula="rotation about x and y at both ends of the link: k M there",
        source="virtual joint model as in Klimchik et al. 2014, three nodes",
        claim="{place} bends elsewhere than at its middle",
    )
    parameters = tuple(
        Parameter(f"k_{end}_{axis}_rad_per_Nm", f"bending about {axis} at its {end} end, beside its middle", 0.05)
        for end in ("near", "far")
        for axis in "xy"
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every link that carries another one and has a length."""
        return tuple(place for place in LateralCompliance.places(arm) if place in chain_of(arm).hinges)

    @property
    def targets(self) -> tuple[str, ...]:
        """The bending angles of both ends."""
        return tuple(f"{self.place}.{end}_{axis}" for end in ("near", "far") for axis in "xy")


class BaseCompliance(Spring):
    """Torsional compliance of the base structure about its other two axes."""

    id = "base_compliance"
    about = Description(
        cause="The structure under the arm twists and rocks sideways too, not only forwards.",
        formula="δα = k_x τ_x, δγ = k_z τ_z of the base; about z it is the same as the compliance of joint 1",
        source="as the base compliance of Conenna 2024, section 4.3, about the axes it leaves out",
        claim="the base rocks by {k_x_rad_per_Nm} about its x",
    )
    parameters = (
        Parameter("k_x_rad_per_Nm", "compliance of the base about its x", 0.03, lower=0.0),
        Parameter("k_z_rad_per_Nm", "compliance of the base about its z", 0.03, lower=0.0),
    )
    targets = ("base.alpha", "base.gamma")

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The base."""
        return (BASE,)


SPRINGS: tuple[type[Spring], ...] = (Compliance, BaseCompliance, LateralCompliance)
"""Linear springs of every slot that has one, each in one way."""


class NonlinearStiffness(LoadedJointEffect, LinearEffect):
    """A joint with a nonlinear spring: stiffness that changes with the torque."""

    id = "nonlinear_stiffness"
    about = Description(
        cause="Gears and plastic under a joint are softer at first and stiffen as they are loaded, or the reverse.",
        formula="δq = c2 τ|τ| + c3 τ³ within the measured torque",
        source="series in the torque; the linear term is the effect compliance",
        claim="the spring of {place} is not linear: {c2_rad_per_Nm2}, {c3_rad_per_Nm3}",
        needs="torques of several sizes, best with several loads",
    )
    depends_on = ()
    parameters = (
        Parameter("c2_rad_per_Nm2", "quadratic compliance, of either sign", 0.05),
        Parameter("c3_rad_per_Nm3", "cubic compliance, of either sign", 0.05),
    )

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """τ|τ| and τ³."""
        return (tau[0] * magnitude(tau[0]),), (tau[0] * (tau[0] * tau[0]),)
