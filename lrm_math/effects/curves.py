"""Free forms of effects: smooth functions of an effect's own covariate, linear in their coefficients.

A plain effect has one formula. Where the residual at its place still follows its covariate (an angle, a torque, the
time), the cause is right and the formula is not: one of these functions is then fitted beside it, as a generalised
additive model would (Hastie & Tibshirani 1986).
"""

from __future__ import annotations

from functools import cached_property
from itertools import combinations
from math import ceil, radians
from typing import ClassVar

from lrm_math.arm.arm import Arm
from lrm_math.arm.place_names import both, joint_numbers, joints_of
from lrm_math.effects.base import (
    Amounts,
    Description,
    Excitation,
    JointEffect,
    LinearEffect,
    Parameter,
    separately,
)
from lrm_math.effects.servo_errors import CoupledJoints, coupled_joints
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import ends_of, magnitude, positive_part

TYPICAL = 0.02
"""rad: typical size of a coefficient."""
CABLE_SPACING = radians(50.0)
REACH = 2.0
"""Knots from the middle of a cubic B-spline to where it ends."""


def cubic_b_splines(x: Number, lower: float, upper: float, spacing: float) -> Amounts:
    """Uniform cubic B-splines (de Boor 1978) at knots no more than `spacing` apart between two values of x.

    One that is zero at every x is the number zero.
    """
    count = spline_count(lower, upper, spacing)
    scaled = (x - lower) * ((count - 3) / (upper - lower)) + 1.0
    first, last = ends_of(scaled)
    return tuple(_b_spline(magnitude(scaled - i)) if first - REACH < i < last + REACH else 0.0 for i in range(count))


def _b_spline(u: Number) -> Number:
    """The cubic B-spline at a distance u from its middle, in knots."""
    outer, inner = positive_part(REACH - u), positive_part(1.0 - u)
    return (outer * outer * outer - 4.0 * (inner * inner * inner)) * (1.0 / 6.0)


def spline_count(lower: float, upper: float, spacing: float) -> int:
    """Number of B-splines that are not zero everywhere between two values."""
    return max(ceil((upper - lower) / spacing - 1e-9), 1) + 3


class _AngleSpline(LinearEffect):
    """A cubic spline of one joint's commanded angle over its limits, with knots `spacing` apart (rad)."""

    depends_on = ("angle",)
    spacing: ClassVar[float]

    @property
    def followed(self) -> int:
        """Number from 0 of the joint whose angle it follows."""
        raise NotImplementedError

    @cached_property
    def _limits(self) -> tuple[float, float]:
        joint = self.arm.joints[self.followed]
        return joint.lower, joint.upper

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One coefficient for each B-spline."""
        angle, count = f"joint {self.followed + 1}'s angle", spline_count(*self._limits, self.spacing)
        return tuple(Parameter(f"c{i}_rad", f"B-spline {i} of {angle}", TYPICAL) for i in range(1, count + 1))

    @property
    def curves(self) -> tuple[tuple[str, ...], ...]:
        """One curve."""
        return (tuple(parameter.name for parameter in self.parameters),)

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """The B-splines of that joint's angle."""
        return separately([cubic_b_splines(poses.angle(self.followed), *self._limits, self.spacing)])

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Needs as many levels as a line and a bend, at least."""
        return _too_few_levels(excitation, self.followed, f"joint {self.followed + 1}", 6)


class AngleCurve(_AngleSpline, JointEffect):
    """Free function of a joint's own angle: stops, cables, teeth and poles, a table read badly."""

    id = "angle_curve"
    variant_of = ("servo_gain", "eccentricity", "gear_ripple", "cable_spring")
    about = Description(
        cause="A servo errs over its own angle as its potentiometer, teeth, poles, stops and cables make it err.",
        formula="δq = cubic spline of q",
        source="cubic B-splines, de Boor 1978",
        claim="{place} errs by a curve over its own angle",
        needs="seven or more angles of the joint",
    )
    spacing = radians(10.0)

    @property
    def followed(self) -> int:
        """The joint itself."""
        return self.joint


class CouplingCurve(CoupledJoints, _AngleSpline):
    """Free function of another joint's angle."""

    id = "coupling_curve"
    variant_of = ("coupling",)
    about = Description(
        cause="A cable or a shared mount lets one joint turn another one, not in proportion.",
        formula="δq_N = cubic spline of q_M",
        source="cubic B-splines, de Boor 1978",
        claim="{place} by a curve",
        needs="seven or more angles of the other joint",
    )
    spacing = radians(25.0)

    @property
    def followed(self) -> int:
        """The other joint."""
        return coupled_joints(self.place)[1]


class CableCurve(LinearEffect):
    """A cable or bundle over two joints, which pulls on both by a free function of the sum or difference of angles."""

    id = "cable_curve"
    variant_of = ("cable_spring@{0}", "cable_spring@{1}", "coupling@{0}<-{1}", "coupling@{1}<-{0}")
    depends_on = ("angle",)
    about = Description(
        cause="A cable that runs over two joints tightens as they turn together, and pulls on both.",
        formula="torque −f(q_A + q_B) on both joints, or −g(q_A − q_B) on A and +g on B; cubic splines",
        source="cubic B-splines, de Boor 1978",
        claim="a cable over {place} pulls on both",
        needs="both joints at several angles",
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every pair of joints: `jointA+jointB`."""
        return tuple(both(a, b) for a, b in combinations(arm.joint_names, 2))

    @cached_property
    def _pair(self) -> tuple[int, int]:
        a, b = joint_numbers(self.place)
        return a, b

    @cached_property
    def _ranges(self) -> tuple[tuple[float, float], ...]:
        """Splines of the sum and of the difference of angles (rad)."""
        a, b = (self.arm.joints[joint] for joint in self._pair)
        return (a.lower + b.lower, a.upper + b.upper), (a.lower - b.upper, a.upper - b.lower)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One torque for each B-spline of the sum and of the difference."""
        return tuple(
            Parameter(f"{name}{i}_Nm", f"B-spline {i} of the {what} of the angles", 0.2)
            for name, what, ends in zip("sd", ("sum", "difference"), self._ranges, strict=True)
            for i in range(1, spline_count(*ends, CABLE_SPACING) + 1)
        )

    @property
    def curves(self) -> tuple[tuple[str, ...], ...]:
        """One of the sum and one of the difference."""
        names = [parameter.name for parameter in self.parameters]
        return tuple(tuple(name for name in names if name.startswith(of)) for of in "sd")

    @property
    def targets(self) -> tuple[str, ...]:
        """The torques on both axes."""
        return tuple(f"{joint}.theta.load" for joint in joints_of(self.place))

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Both joints must move."""
        still = [joint for joint in self._pair if excitation.levels(joint) < 3]
        return f"joint {still[0] + 1} was measured at {excitation.levels(still[0])} angles only" if still else None

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """Minus the B-splines of the sum on both; minus those of the difference on the first, plus on the second."""
        a, b = (poses.angle(joint) for joint in self._pair)
        by_sum, by_difference = (
            cubic_b_splines(x, *ends, CABLE_SPACING) for x, ends in zip((a + b, a - b), self._ranges, strict=True)
        )
        return (*((-f, -f) for f in by_sum), *((-f, f) for f in by_difference))


def _too_few_levels(excitation: Excitation, joint: int, name: str, needed: int) -> str | None:
    levels = excitation.levels(joint)
    return None if levels >= needed else f"{name} was measured at {levels} angles only"
