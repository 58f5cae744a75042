"""Free forms of effects: smooth functions of an effect's own driver, linear in their coefficients.

A plain effect has one formula. Where the residual at its place still follows its driver (an angle, a torque, the time),
the cause is right and the formula is not: one of these functions is then fitted beside it, as a generalised additive
model would (Hastie & Tibshirani 1986).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from math import ceil, radians

import numpy as np

from lrm_math.arm.arm import BASE, Arm
from lrm_math.effects.base import (
    Amounts,
    AngleDependentEffect,
    Effect,
    Excitation,
    JointEffect,
    LoadedJointEffect,
    Parameter,
    joint_number,
)
from lrm_math.effects.session_errors import Drift
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import cos, magnitude, positive_part, sin, tanh

TYPICAL = 0.02
"""rad: typical size of a coefficient."""
KNOT_SPACING = radians(25.0)
WAVES = (3, 4, 5, 6)
TORQUE_SCALES = (0.02, 0.06, 0.2)
"""N·m: torques that take up 76 % of each part of a torque curve."""
TIME_CONSTANTS = (120, 600, 3000, 15000)


class Curve(Effect):
    """A linear combination of fixed functions, added to every slot that the effect moves."""

    @abstractmethod
    def basis(self, poses: Poses, tau: Amounts) -> Amounts:
        """The functions, each a float or (N,), in the order of the coefficients of one slot."""

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Σ c_i f_i for each slot."""
        functions = self.basis(poses, tau)
        count = len(functions)
        return tuple(
            sum((c * f for c, f in zip(p[k * count : (k + 1) * count], functions, strict=True)), 0.0)
            for k in range(len(self.moves))
        )

    def d_parameters(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """The functions themselves, at the coefficient's own slot."""
        functions, slots = self.basis(poses, tau), len(self.moves)
        return tuple(tuple(f if i == k else 0.0 for i in range(slots)) for k in range(slots) for f in functions)


def cubic_b_splines(angle: Number, lower: float, upper: float) -> Amounts:
    """Uniform cubic B-splines (de Boor 1978) at knots no more than `KNOT_SPACING` apart between two angles (rad)."""
    count = spline_count(lower, upper)
    spacing = (upper - lower) / (count - 3)
    places = [magnitude((angle - lower) / spacing + 1.0 - i) for i in range(count)]
    return tuple((positive_part(2.0 - u) ** 3 - 4.0 * positive_part(1.0 - u) ** 3) / 6.0 for u in places)


def spline_count(lower: float, upper: float) -> int:
    """Number of B-splines that are not zero everywhere between two angles (rad)."""
    return max(ceil((upper - lower) / KNOT_SPACING - 1e-9), 1) + 3


class TorqueCurve(Curve, LoadedJointEffect):
    """Free smooth function of a joint's torque: sums of saturations, the two sides of zero for themselves."""

    id = "torque_curve"
    refines = ("backlash", "nonlinear_stiffness")
    cause = "Play with unequal sides, or gears that yield in several stages, follow the torque by a curve of their own."
    formula = "δq = Σ u_i tanh(τ/s_i) + v_i tanh²(τ/s_i), s = 0.02, 0.06, 0.2 N·m"
    source = "stop operators of Prandtl and Ishlinskii, smoothed and without memory"
    needs = "torques of several sizes"
    claim = "{place} follows its torque by a curve of its own"
    follows_angles = False
    parameters = tuple(
        Parameter(f"{name}{i}_rad", f"{part} of the curve that {scale:g} N·m take up", TYPICAL)
        for i, scale in enumerate(TORQUE_SCALES, start=1)
        for name, part in (("u", "part alike on both sides"), ("v", "difference between the sides"))
    )

    def basis(self, poses: Poses, tau: Amounts) -> Amounts:
        """tanh and tanh² of the torque at each scale."""
        taken = [tanh(tau[0] / scale) for scale in TORQUE_SCALES]
        return tuple(f for t in taken for f in (t, t * t))

    def d_tau(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """Σ (u_i + 2 v_i tanh) sech² / s_i."""
        taken = [tanh(tau[0] / scale) for scale in TORQUE_SCALES]
        parts = zip(p[::2], p[1::2], taken, TORQUE_SCALES, strict=True)
        return ((sum(((u + 2.0 * v * t) * (1.0 - t * t) / s for u, v, t, s in parts), 0.0),),)


class AngleHarmonics(Curve, AngleDependentEffect):
    """Periodic error of a joint with three to six waves a turn: teeth, magnets and poles."""

    id = "angle_harmonics"
    refines = ("eccentricity",)
    cause = "A gear's teeth or an encoder's poles repeat an error several times a turn."
    formula = "δq = Σ a_n sin nq + b_n (cos nq − 1), n = 3 … 6"
    source = "Fourier series of a periodic error of the joint, higher terms"
    needs = "more levels of the joint than twice its waves"
    claim = "{place} turns unevenly several times a turn"
    parameters = tuple(
        Parameter(f"{letter}{n}_rad", f"amplitude of {wave} {n}q", TYPICAL / 2)
        for n in WAVES
        for letter, wave in (("a", "sin"), ("b", "cos"))
    )

    def basis(self, poses: Poses, tau: Amounts) -> Amounts:
        """sin nq and cos nq − 1."""
        q = poses.angle(self.joint)
        return tuple(wave for n in WAVES for wave in (sin(n * q), cos(n * q) - 1.0))

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """As many levels as terms."""
        return _too_few_levels(excitation, self.joint, self.place, len(self.parameters))


class _AngleSpline(Curve):
    """A cubic spline of one joint's commanded angle over its limits."""

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
        angle, count = f"joint {self.followed + 1}'s angle", spline_count(*self._limits)
        return tuple(Parameter(f"c{i}_rad", f"B-spline {i} of {angle}", TYPICAL) for i in range(1, count + 1))

    def basis(self, poses: Poses, tau: Amounts) -> Amounts:
        """The B-splines of the driver's angle."""
        return cubic_b_splines(poses.angle(self.followed), *self._limits)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """As many levels as a line and a bend need, at least."""
        return _too_few_levels(excitation, self.followed, f"joint{self.followed + 1}", 6)


class AngleCurve(_AngleSpline, JointEffect):
    """Free function of a joint's own angle: stops, cables, worn teeth, a table read badly."""

    id = "angle_curve"
    refines = ("servo_gain", "eccentricity", "cable_spring")
    cause = "A servo's own error over its angle has whatever shape its potentiometer, teeth, stops and cables give it."
    formula = "δq = cubic spline of q"
    source = "cubic B-splines, de Boor 1978"
    needs = "six or more levels of the joint"
    claim = "{place} errs by a curve over its own angle"

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


class DriftCurve(Curve):
    """Drift with several time constants: a spectrum of first-order lags."""

    id = "drift_curve"
    refines = ("drift",)
    cause = "Servo, gears and structure warm up one after the other, each at its own pace."
    formula = "δ = Σ A_i (1 − exp(−t/T_i)), T = 120, 600, 3000, 15000 s"
    source = "discrete relaxation spectrum (Prony series)"
    needs = Drift.needs
    claim = "{place} drifts with several time constants"
    online = False
    follows_angles = False

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """As the drift that it refines."""
        return Drift.places(arm)

    @property
    def driver(self) -> str:
        """The time."""
        return "t"

    @property
    def moves(self) -> tuple[str, ...]:
        """The joint's angle, or the base's tilts."""
        return ("base.alpha", "base.beta") if self.place == BASE else (f"{self.place}.theta",)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The final size of each lag, for each angle."""
        ends = ("_alpha", "_beta") if self.place == BASE else ("",)
        return tuple(
            Parameter(f"A{end}_{T}s_rad", f"drift of {self.place}{end} with time constant {T} s", 0.01)
            for end in ends
            for T in TIME_CONSTANTS
        )

    def basis(self, poses: Poses, tau: Amounts) -> Amounts:
        """1 − exp(−t/T), zero where the time is not known."""
        t = np.zeros(len(poses)) if poses.t is None else poses.t
        return tuple(1.0 - np.exp(-t / T) for T in TIME_CONSTANTS)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Times must be known."""
        return "the data have no times (t_s)" if excitation.poses.t is None else None


def _too_few_levels(excitation: Excitation, joint: int, name: str, needed: int) -> str | None:
    levels = excitation.levels(joint)
    return None if levels >= needed else f"{name} stands at {levels} levels only"
