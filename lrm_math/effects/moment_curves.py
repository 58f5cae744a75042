"""Free functions of the moment at a place: a joint's torque, the moments in a bearing and under the base."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_math.arm.arm import BASE, Arm
from lrm_math.effects.base import Amounts, LoadedJointEffect, Parameter
from lrm_math.effects.compliance import BendingEnds
from lrm_math.effects.curves import TYPICAL, Curve
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import tanh

TORQUE_SCALES = (0.02, 0.06, 0.2)
"""N·m: torques that take up 76 % of each part of a torque curve."""
BEARING_SCALES = (0.03, 0.1, 0.3)
BASE_SCALES = (0.05, 0.15, 0.45, 1.35)
"""N·m: likewise."""


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

    def basis(self, poses: Poses, tau: Amounts, slot: int = 0) -> Amounts:
        """tanh and tanh² of the torque at each scale."""
        taken = [tanh(tau[0] / scale) for scale in TORQUE_SCALES]
        return tuple(f for t in taken for f in (t, t * t))

    def d_tau(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """Σ (u_i + 2 v_i tanh) sech² / s_i."""
        taken = [tanh(tau[0] / scale) for scale in TORQUE_SCALES]
        parts = zip(p[::2], p[1::2], taken, TORQUE_SCALES, strict=True)
        return ((sum(((u + 2.0 * v * t) * (1.0 - t * t) / s for u, v, t, s in parts), 0.0),),)


class BearingCurve(Curve):
    """A bearing with clearance at the far end of a link: it tilts along the moment across its axis, and saturates."""

    id = "bearing_curve"
    refines = ("lateral_compliance",)
    cause = "The bearing of the next joint has clearance: it tilts at once under a small moment, and hardly more later."
    formula = "rotation about x and y of the far end: Σ c_i M / √(|M|² + s_i²), s = 0.03, 0.1, 0.3 N·m"
    source = "bearing clearance, smoothed; sum of several widths"
    needs = "moments of several sizes in the link"
    claim = "the bearing at the end of {place} has clearance"
    follows_angles = False
    parameters = tuple(
        Parameter(f"c{i}_{axis}_rad", f"tilt about {axis} that {scale:g} N·m take up", TYPICAL)
        for axis in "xy"
        for i, scale in enumerate(BEARING_SCALES, start=1)
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """As hinges at the ends of links."""
        return BendingEnds.places(arm)

    @property
    def bends_at_ends(self) -> tuple[str, ...]:
        """The link."""
        return (self.place,)

    @property
    def moves(self) -> tuple[str, ...]:
        """The bending angles of the far end."""
        return tuple(f"{self.place}.far_{axis}" for axis in "xy")

    @property
    def feels(self) -> tuple[str, ...]:
        """The moments about the axes that it turns."""
        return self.moves

    def basis(self, poses: Poses, tau: Amounts, slot: int = 0) -> Amounts:
        """M/√(|M|² + s²) about one axis."""
        square = tau[0] * tau[0] + tau[1] * tau[1]
        return tuple(tau[slot] / (square + scale * scale) ** 0.5 for scale in BEARING_SCALES)


class BaseCurve(Curve):
    """A base that gives way by a curve: it lifts off on one side, or rocks in a play."""

    id = "base_curve"
    refines = ("base_compliance", "compliance")
    cause = "A plate that is screwed on at one side, or stands on its feet, gives way to one side more than the other."
    formula = "rotation about each base axis: Σ u_i tanh(M/s_i) + v_i tanh²(M/s_i), s = 0.05, 0.15, 0.45, 1.35 N·m"
    source = "as the torque curve of a joint"
    needs = "moments of several sizes on the base"
    claim = "the base gives way by a curve"
    follows_angles = False
    moves = ("base.alpha", "base.beta", "base.gamma")
    feels = moves
    parameters = tuple(
        Parameter(f"{name}{i}_{angle}_rad", f"{part} about {angle} that {scale:g} N·m take up", TYPICAL)
        for angle in ("alpha", "beta", "gamma")
        for i, scale in enumerate(BASE_SCALES, start=1)
        for name, part in (("u", "part alike on both sides"), ("v", "difference between the sides"))
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The base."""
        return (BASE,)

    def basis(self, poses: Poses, tau: Amounts, slot: int = 0) -> Amounts:
        """tanh and tanh² of the moment at each scale."""
        taken = [tanh(tau[slot] / scale) for scale in BASE_SCALES]
        return tuple(f for t in taken for f in (t, t * t))
