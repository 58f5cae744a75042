"""Free functions of the moment at a place: a joint's torque, the moments in a bearing and under the base."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_math.arm.arm import BASE, Arm
from lrm_math.effects.base import Amounts, Description, LinearEffect, LoadedJointEffect, Parameter, separately
from lrm_math.effects.compliance import BendingEnds
from lrm_math.effects.curves import TYPICAL
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import tanh

TORQUE_SCALES = (0.02, 0.06, 0.2)
"""N·m: torques that take up 76 % of each part of a torque curve."""
BEARING_SCALES = (0.03, 0.1, 0.3)
BASE_SCALES = (0.05, 0.15, 0.45, 1.35)
"""N·m: likewise."""


class TorqueCurve(LoadedJointEffect, LinearEffect):
    """Free smooth function of a joint's torque: sums of saturations, the two sides of zero for themselves."""

    id = "torque_curve"
    variant_of = ("backlash", "nonlinear_stiffness")
    depends_on = ()
    about = Description(
        cause=(
            "Play with unequal sides, or gears that yield in several stages, follow the torque by a curve of their own."
        ),
        formula="δq = Σ u_i tanh(τ/s_i) + v_i tanh²(τ/s_i), s = 0.02, 0.06, 0.2 N·m",
        source="stop operators of Prandtl and Ishlinskii, smoothed and without memory",
        claim="{place} follows its torque by a curve of its own",
        needs="torques of several sizes",
    )
    parameters = tuple(
        Parameter(f"{name}{i}_rad", f"{part} of the curve that {scale:g} N·m take up", TYPICAL)
        for i, scale in enumerate(TORQUE_SCALES, start=1)
        for name, part in (("u", "part alike on both sides"), ("v", "difference between the sides"))
    )

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """tanh and tanh² of the torque at each scale."""
        return separately([_saturations(tau[0], TORQUE_SCALES)])


class BearingCurve(LinearEffect):
    """A bearing with clearance at the far end of a link: it tilts along the moment across its axis, and saturates."""

    id = "bearing_curve"
    variant_of = ("lateral_compliance",)
    depends_on = ()
    about = Description(
        cause=(
            "The bearing of the next joint has clearance: it tilts at once under a small moment, and hardly more later."
        ),
        formula="rotation about x and y of the far end: Σ c_i M / √(|M|² + s_i²), s = 0.03, 0.1, 0.3 N·m",
        source="bearing clearance, smoothed; sum of several widths",
        claim="the bearing at the end of {place} has clearance",
        needs="moments of several sizes in the link",
    )
    parameters = tuple(
        Parameter(f"c{i}_{axis}_rad", f"tilt about {axis} that {scale:g} N·m take up", TYPICAL)
        for axis in "xy"
        for i, scale in enumerate(BEARING_SCALES, start=1)
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every place of hinges at the ends of links."""
        return BendingEnds.places(arm)

    @property
    def targets(self) -> tuple[str, ...]:
        """The bending angles of the far end."""
        return tuple(f"{self.place}.far_{axis}" for axis in "xy")

    @property
    def load_slots(self) -> tuple[str, ...]:
        """The moments about the axes that it turns."""
        return self.targets

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """M/√(|M|² + s²) about each axis."""
        square = tau[0] * tau[0] + tau[1] * tau[1]
        return separately([tuple(M / (square + scale * scale) ** 0.5 for scale in BEARING_SCALES) for M in tau])


class BaseCurve(LinearEffect):
    """A base that gives way by a curve: it lifts off on one side, or rocks in a play."""

    id = "base_curve"
    variant_of = ("base_compliance", "compliance")
    depends_on = ()
    about = Description(
        cause=(
            "A plate that is screwed on at one side, or stands on its feet, gives way to one side more than the other."
        ),
        formula="rotation about each base axis: Σ u_i tanh(M/s_i) + v_i tanh²(M/s_i), s = 0.05, 0.15, 0.45, 1.35 N·m",
        source="as the torque curve of a joint",
        claim="the base gives way by a curve",
        needs="moments of several sizes on the base",
    )
    targets = load_slots = ("base.alpha", "base.beta", "base.gamma")
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

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """tanh and tanh² of the moments at each scale."""
        return separately([_saturations(moment, BASE_SCALES) for moment in tau])


def _saturations(load: Number, scales: Sequence[float]) -> Amounts:
    """tanh and tanh² of a load at each scale."""
    taken = [tanh(load / scale) for scale in scales]
    return tuple(f for t in taken for f in (t, t * t))
