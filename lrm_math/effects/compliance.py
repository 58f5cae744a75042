"""Level 3: joints and base give way to gravity in proportion to its moment (thesis section 4.3, 7 parameters)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lrm_math.arm.arm import BASE, Arm
from lrm_math.effects.base import Amounts, Effect, LoadedJointEffect, Parameter
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import size


@dataclass(frozen=True)
class Compliance(Effect):
    """A linear torsion spring in one joint, or in the base about its y axis."""

    id = "compliance"
    cause = "Servo, gears and plastic around a joint twist under the torque that they hold, like a spring."
    formula = "δq = k τ; the base: δβ = k τ about its y axis"
    source = "Conenna 2024, section 4.3; Kamali et al. 2016"
    claim = "{place} gives way by {k_rad_per_Nm}"
    linear = True
    follows_angles = False

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The base and every joint."""
        return (BASE, *arm.joint_names)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The compliance k."""
        return (Parameter("k_rad_per_Nm", f"compliance of {self.place}", 0.1, lower=0.0),)

    @property
    def moves(self) -> tuple[str, ...]:
        """The joint's angle, or the base's tilt about y."""
        return ("base.beta",) if self.place == BASE else (f"{self.place}.theta",)

    @property
    def feels(self) -> tuple[str, ...]:
        """The moment about the axis that it turns."""
        return self.moves

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """k τ."""
        return (p[0] * tau[0],)

    def d_parameters(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """τ."""
        return ((tau[0],),)

    def d_tau(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """k."""
        return ((float(p[0]),),)


@dataclass(frozen=True)
class LateralCompliance(Effect):
    """A link that bends about the x and y of its far frame, at half its length."""

    id = "lateral_compliance"
    cause = "A printed link bends sideways under the moment that runs through it, not only its joint twists."
    formula = "rotation of the link about x and y: k_x M_x, k_y M_y"
    source = "rotational virtual springs as in Klimchik et al. 2014; Conenna 2024 leaves them out (section 4.3)"
    claim = "{place} bends by {k_x_rad_per_Nm} about its x and {k_y_rad_per_Nm} about its y"
    linear = True
    follows_angles = False

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every link that carries another one."""
        return tuple(f"link{i}" for i in range(1, arm.dof))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The two bending compliances."""
        return tuple(
            Parameter(f"k_{axis}_rad_per_Nm", f"bending of {self.place} about its {axis}", 0.05, lower=0.0)
            for axis in "xy"
        )

    @property
    def moves(self) -> tuple[str, ...]:
        """The link's two bending angles."""
        return (f"{self.place}.x", f"{self.place}.y")

    @property
    def feels(self) -> tuple[str, ...]:
        """The moments about the same axes."""
        return self.moves

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """k M about each axis."""
        return (p[0] * tau[0], p[1] * tau[1])

    def d_parameters(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """M about the parameter's own axis."""
        return ((tau[0], 0.0), (0.0, tau[1]))

    def d_tau(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """k about the moment's own axis."""
        return ((float(p[0]), 0.0), (0.0, float(p[1])))


@dataclass(frozen=True)
class BaseCompliance(Effect):
    """The base structure gives way about its other two axes."""

    id = "base_compliance"
    cause = "The structure under the arm twists and rocks sideways too, not only forwards."
    formula = "δα = k_x τ_x, δγ = k_z τ_z of the base; about z it is the same as the compliance of joint 1"
    source = "as the base compliance of Conenna 2024, section 4.3, about the axes it leaves out"
    claim = "the base rocks by {k_x_rad_per_Nm} about its x"
    linear = True
    follows_angles = False

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The base."""
        return (BASE,)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The two compliances."""
        return tuple(
            Parameter(f"k_{axis}_rad_per_Nm", f"compliance of the base about its {axis}", 0.03, lower=0.0)
            for axis in "xz"
        )

    @property
    def moves(self) -> tuple[str, ...]:
        """The base's two other angles."""
        return ("base.alpha", "base.gamma")

    @property
    def feels(self) -> tuple[str, ...]:
        """The moments about the same axes."""
        return self.moves

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """k τ about each axis."""
        return (p[0] * tau[0], p[1] * tau[1])


@dataclass(frozen=True)
class NonlinearStiffness(LoadedJointEffect):
    """A joint whose spring gets stiffer or softer with its torque."""

    id = "nonlinear_stiffness"
    cause = "Gears and plastic under a joint are softer at first and stiffen as they are loaded, or the reverse."
    formula = "δq = c2 τ|τ| + c3 τ³"
    source = "series in the torque; the linear term is the effect compliance"
    needs = "torques of several sizes, best with several loads"
    claim = "the spring of {place} is not linear: {c2_rad_per_Nm2}, {c3_rad_per_Nm3}"
    follows_angles = False

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The two coefficients, of either sign."""
        return (
            Parameter("c2_rad_per_Nm2", f"quadratic compliance of {self.place}", 0.05),
            Parameter("c3_rad_per_Nm3", f"cubic compliance of {self.place}", 0.05),
        )

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """c2 τ|τ| + c3 τ³."""
        return (tau[0] * (p[0] * size(tau[0]) + p[1] * tau[0] * tau[0]),)

    def d_parameters(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """τ|τ| and τ³."""
        return ((tau[0] * size(tau[0]),), (tau[0] ** 3,))

    def d_tau(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """2 c2 |τ| + 3 c3 τ²."""
        return ((2.0 * p[0] * size(tau[0]) + 3.0 * p[1] * tau[0] ** 2,),)
