"""Level 3: elastic deflection of joints, links and base under gravity (thesis section 4.3, 7 parameters)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np

from lrm_math.arm.arm import BASE, TOOL, Arm, TypicalSizes
from lrm_math.effects.base import (
    Amounts,
    Description,
    Effect,
    Excitation,
    Extrapolation,
    LinearEffect,
    LoadedJointEffect,
    Parameter,
    separately,
)
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.dual import Dual
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import magnitude


class Spring(Effect):
    """Linear springs of some slots: δ = k · load, each k a function of the parameters."""

    depends_on = ()
    extrapolation = Extrapolation.PROPORTIONAL

    @property
    def load_slots(self) -> tuple[str, ...]:
        """The loads on the slots that it moves."""
        return self.targets

    def compliances(self, p: Sequence[float]) -> tuple[float, ...]:
        """Compliance of each target (rad/N·m)."""
        return tuple(p)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """k · load."""
        both = zip(self.compliances(p), tau, strict=True)
        return tuple(k * load if isinstance(k, Dual) or k else 0.0 for k, load in both)


class PlainSpring(Spring, LinearEffect):
    """Linear springs whose compliances are the parameters."""

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """The load on each slot."""
        return separately([(load,) for load in tau])


class Compliance(PlainSpring):
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


class ToolCompliance(PlainSpring):
    """Turns of the tool on the last link about its three axes, under the moments of what it carries."""

    id = "tool_compliance"
    about = Description(
        cause="The mount of the tool gives way: a load that is gripped turns it against the last link.",
        formula="turn of the tool about x, y and z: k_x M_x, k_y M_y, k_z M_z",
        source="rotational virtual springs as in Klimchik et al. 2014, at the tool",
        claim="{place} turns by {k_x_rad_per_Nm}, {k_y_rad_per_Nm}, {k_z_rad_per_Nm} about x, y, z",
        needs="different loads (payload_g)",
    )
    targets: ClassVar[tuple[str, ...]] = tuple(f"{TOOL}.{turn}" for turn in ("alpha", "beta", "gamma"))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One about each axis, as large as of the joints of such an arm."""
        size = self.arm.typical_sizes.compliance
        names = {axis: f"compliance of the mount about {axis}" for axis in "xyz"}
        return tuple(Parameter(f"k_{axis}_rad_per_Nm", words, size, lower=0.0) for axis, words in names.items())

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The tool."""
        return (TOOL,)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The load must differ: with one load it is, as it hangs, much like an error of the tool."""
        return None if len(np.unique(excitation.poses.payload)) > 1 else "all poses have one load"


class ServoDroop(PlainSpring, LoadedJointEffect):
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
        needs="joint feedback (q1_meas_deg …)",
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
        if "feedback" in excitation.measured:
            return None
        return "without joint feedback it is indistinguishable from the joint's compliance"


BEND_POINT = Parameter(
    "s_ratio",
    "point of the bend along the link, from 0 at its near end to 1 at its far end",
    0.25,
    0.0,
    1.0,
    fixed=0.5,
    scan=(0.0, 0.25, 0.5, 0.75, 1.0),
    usual=1.0,
    largest=1.0,
)


class LateralCompliance(Spring):
    """Bending of a link about the x and y of its far frame, at one point along it (virtual joint model).

    Moment and lever of a hinge at s are linear in s, so what it moves is a quadratic of s. Hinges at both ends and the
    middle, each as compliant as its Lagrange polynomial at s says, therefore move the same to first order.
    """

    id = "lateral_compliance"
    about = Description(
        cause="A printed link bends sideways under the moment that runs through it, not only its joint twists.",
        formula="rotation of the link about x and y: k_x M_x, k_y M_y at the share s of its length",
        source="rotational virtual springs as in Klimchik et al. 2014; Conenna 2024 leaves them out (section 4.3)",
        claim="{place} bends by {k_x_rad_per_Nm} about its x and {k_y_rad_per_Nm} about its y",
    )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Compliances about x and y; of a link that has a length the point of the bend."""
        both = tuple(
            Parameter(f"k_{axis}_rad_per_Nm", f"bending of the link about its {axis}", 0.05, lower=0.0) for axis in "xy"
        )
        return (*both, BEND_POINT) if self.has_length else both

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every link that carries another one."""
        return tuple(f"link{i}" for i in range(1, len(arm.links)))

    @cached_property
    def has_length(self) -> bool:
        """Whether the link has ends apart from its middle."""
        return self.place in chain_of(self.arm).hinges

    @cached_property
    def targets(self) -> tuple[str, ...]:
        """The two bending angles at the link's middle, and of a link with a length at its ends."""
        nodes = ("", "near_", "far_") if self.has_length else ("",)
        return tuple(f"{self.place}.{node}{axis}" for node in nodes for axis in "xy")

    def point(self, p: Sequence[float]) -> float | None:
        """Share of the link's length at which it bends; None of a link without a length."""
        return p[-1] if self.has_length else None

    def compliances(self, p: Sequence[float]) -> tuple[float, ...]:
        """Those about x and y, times the Lagrange polynomial of each node at s."""
        if not self.has_length:
            return tuple(p)
        x, y, s = p
        nodes = 4.0 * s * (1.0 - s), (1.0 - s) * (1.0 - 2.0 * s), s * (2.0 * s - 1.0)
        return tuple(node * k for node in nodes for k in (x, y))


class BendingEnds(PlainSpring):
    """Bending of a link along its length: hinges at its near and far end, beside its one bend.

    The far end is the bearing of the next joint.
    """

    id = "bending_ends"
    variant_of = ("lateral_compliance",)
    about = Description(
        cause="A link bends along its length, or elsewhere about one axis than about the other.",
        formula="rotation about x and y at both ends of the link: k M there",
        source="virtual joint model as in Klimchik et al. 2014, three nodes",
        claim="{place} bends at more than one point",
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


class BaseCompliance(PlainSpring):
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
        claim="the spring of {place} is not linear: {c2_rad_per_Nm2:softer|stiffer}, {c3_rad_per_Nm3:softer|stiffer} "
        "under load",
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
