"""Free forms of effects: smooth functions of an effect's own driver, linear in their coefficients.

A plain effect has one formula. Where the residual at its place still follows its driver (an angle, a torque, the time),
the cause is right and the formula is not: one of these functions is then fitted beside it, as a generalised additive
model would (Hastie & Tibshirani 1986).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import combinations
from math import ceil, radians
from typing import ClassVar

from lrm_math.arm.arm import Arm
from lrm_math.effects.base import Amounts, Effect, Excitation, JointEffect, Parameter, joint_number
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import magnitude, positive_part

TYPICAL = 0.02
"""rad: typical size of a coefficient."""
CABLE_SPACING = radians(50.0)


class Curve(Effect):
    """A linear combination of fixed functions, added to every slot that the effect moves."""

    @abstractmethod
    def basis(self, poses: Poses, tau: Amounts, slot: int = 0) -> Amounts:
        """The functions of one slot, each a float or (N,), in the order of its coefficients; all slots have as many."""

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Σ c_i f_i for each slot."""
        slots = len(self.moves)
        count = len(p) // slots
        return tuple(
            sum((c * f for c, f in zip(p[k * count :], self.basis(poses, tau, k), strict=False)), 0.0)
            for k in range(slots)
        )

    def d_parameters(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """The functions themselves, at the coefficient's own slot."""
        slots = range(len(self.moves))
        return tuple(tuple(f if i == k else 0.0 for i in slots) for k in slots for f in self.basis(poses, tau, k))


def cubic_b_splines(
    x: Number, lower: float, upper: float, spacing: float, which: Iterable[int] | None = None
) -> Amounts:
    """Uniform cubic B-splines (de Boor 1978) at knots no more than `spacing` apart between two values of x.

    `which`: only those of these numbers from 0.
    """
    count = spline_count(lower, upper, spacing)
    scaled = (x - lower) * ((count - 3) / (upper - lower)) + 1.0
    return tuple(_b_spline(magnitude(scaled - i)) for i in (range(count) if which is None else which))


def _b_spline(u: Number) -> Number:
    """The cubic B-spline at a distance u from its middle, in knots."""
    outer, inner = positive_part(2.0 - u), positive_part(1.0 - u)
    return (outer * outer * outer - 4.0 * (inner * inner * inner)) * (1.0 / 6.0)


def spline_count(lower: float, upper: float, spacing: float) -> int:
    """Number of B-splines that are not zero everywhere between two values."""
    return max(ceil((upper - lower) / spacing - 1e-9), 1) + 3


class _AngleSpline(Curve):
    """A cubic spline of one joint's commanded angle over its limits, with knots `spacing` apart (rad)."""

    spacing: ClassVar[float]

    @property
    def followed(self) -> int:
        """Number from 0 of the joint whose angle it follows."""
        raise NotImplementedError

    @property
    def driver(self) -> str:
        """That joint's angle."""
        return f"q{self.followed + 1}"

    @cached_property
    def _limits(self) -> tuple[float, float]:
        joint = self.arm.joints[self.followed]
        return joint.lower, joint.upper

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One coefficient for each B-spline."""
        angle, count = f"joint {self.followed + 1}'s angle", spline_count(*self._limits, self.spacing)
        return tuple(Parameter(f"c{i}_rad", f"B-spline {i} of {angle}", TYPICAL) for i in range(1, count + 1))

    def basis(self, poses: Poses, tau: Amounts, slot: int = 0) -> Amounts:
        """The B-splines of the driver's angle."""
        return cubic_b_splines(poses.angle(self.followed), *self._limits, self.spacing)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """As many levels as a line and a bend need, at least."""
        return _too_few_levels(excitation, self.followed, f"joint{self.followed + 1}", 6)


class AngleCurve(_AngleSpline, JointEffect):
    """Free function of a joint's own angle: stops, cables, teeth and poles, a table read badly."""

    id = "angle_curve"
    refines = ("servo_gain", "eccentricity", "cable_spring")
    cause = "A servo errs over its own angle as its potentiometer, teeth, poles, stops and cables make it err."
    formula = "δq = cubic spline of q"
    source = "cubic B-splines, de Boor 1978"
    needs = "six or more levels of the joint"
    claim = "{place} errs by a curve over its own angle"
    spacing = radians(10.0)

    @property
    def followed(self) -> int:
        """The joint itself."""
        return self.joint


class CouplingCurve(_AngleSpline):
    """Free function of another joint's angle."""

    id = "coupling_curve"
    refines = ("coupling",)
    cause = "A cable or a shared mount lets one joint turn another one, not in proportion."
    formula = "δq_N = cubic spline of q_M"
    source = "cubic B-splines, de Boor 1978"
    needs = "six or more levels of the other joint"
    claim = "{place} couple by a curve"
    spacing = radians(25.0)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every ordered pair of joints: `jointN<-jointM`."""
        return tuple(f"{to}<-{by}" for to in arm.joint_names for by in arm.joint_names if to != by)

    @property
    def followed(self) -> int:
        """The other joint."""
        return joint_number(self.place.split("<-")[1])

    @property
    def moves(self) -> tuple[str, ...]:
        """The angle of the joint that is turned."""
        return (f"{self.place.split('<-')[0]}.theta",)


class CableCurve(Effect):
    """A cable or bundle over two joints, which pulls on both by a free function of the sum or difference of angles."""

    id = "cable_curve"
    refines = ("cable_spring", "coupling")
    cause = "A cable that runs over two joints tightens as they turn together, and pulls on both."
    formula = "torque −f(q_A + q_B) on both joints, or −g(q_A − q_B) on A and +g on B; cubic splines"
    source = "cubic B-splines, de Boor 1978"
    needs = "both joints at several levels"
    claim = "a cable over {place} pulls on both"

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every pair of joints: `jointA+jointB`."""
        return tuple(f"{a}+{b}" for a, b in combinations(arm.joint_names, 2))

    @cached_property
    def _pair(self) -> tuple[int, int]:
        a, b = self.place.split("+")
        return joint_number(a), joint_number(b)

    @property
    def refined(self) -> tuple[str, ...]:
        """A spring of either joint, or a coupling of the two."""
        a, b = self.place.split("+")
        return f"cable_spring@{a}", f"cable_spring@{b}", f"coupling@{a}<-{b}", f"coupling@{b}<-{a}"

    @cached_property
    def _ranges(self) -> tuple[tuple[float, float], ...]:
        """Of the sum and of the difference of angles (rad)."""
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
    def pushes(self) -> tuple[str, ...]:
        """Both axes."""
        return tuple(f"{joint}.theta" for joint in self.place.split("+"))

    def push(self, poses: Poses, p: Sequence[float]) -> Amounts:
        """−Σ c_i B_i of sum and difference."""
        a, b = (poses.angle(joint) for joint in self._pair)
        pulls, left = [], list(p)
        for x, ends in zip((a + b, a - b), self._ranges, strict=True):
            count = spline_count(*ends, CABLE_SPACING)
            acting = [i for i in range(count) if left[i]]
            functions = cubic_b_splines(x, *ends, CABLE_SPACING, acting)
            pulls.append(sum((left[i] * f for i, f in zip(acting, functions, strict=True)), 0.0))
            left = left[count:]
        return -pulls[0] - pulls[1], -pulls[0] + pulls[1]

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Both joints must move."""
        still = [joint for joint in self._pair if excitation.levels(joint) < 3]
        return f"joint{still[0] + 1} stands at {excitation.levels(still[0])} levels only" if still else None


def _too_few_levels(excitation: Excitation, joint: int, name: str, needed: int) -> str | None:
    levels = excitation.levels(joint)
    return None if levels >= needed else f"{name} stands at {levels} levels only"
