"""Backlash, axial play and hysteresis of a joint: clearance, friction and dead band of gears, bearing and servo."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_math.effects.base import (
    FEW_REVERSALS,
    Amounts,
    Description,
    Excitation,
    Extrapolation,
    JointEffect,
    LinearEffect,
    LoadedJointEffect,
    Parameter,
)
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import tanh


class Backlash(LoadedJointEffect):
    """Backlash of one joint, taken up on the side that gravity pulls to."""

    id = "backlash"
    about = Description(
        cause="Gears have play; gravity pushes the joint to one end of it or, when the torque changes sign, the other.",
        formula="δq = ½ b [(1 − w) tanh(τ/τ0) + w τ/√(τ² + τ0²)]",
        source="form after Slamani, Nubiola & Bonev 2012, smoothed at the change of sign in either of two ways",
        claim="{place} has {b_rad} of backlash, end to end",
        needs="torque of both signs at the joint",
    )
    depends_on = ()
    extrapolation = Extrapolation.PROPORTIONAL
    parameters = (
        Parameter("b_rad", "play of the joint, from end to end", 0.02, lower=0.0),
        Parameter(
            "tau0_Nm",
            "torque that takes up 76 % of the play",
            0.02,
            lower=1e-4,
            fixed=0.02,
            scan=(0.003, 0.01, 0.02, 0.04, 0.08, 0.2),
        ),
        Parameter(
            "w_rad_per_rad",
            "share of the play that is taken up slowly, as τ/√(τ² + τ0²)",
            0.5,
            lower=0.0,
            upper=1.0,
            fixed=0.0,
            scan=(0.0, 1.0),
        ),
    )

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """½ b (tanh (1 − w) + w slow), by the torque over τ0."""
        play, scale, slow = p
        x = tau[0] / scale
        return (0.5 * play * ((1.0 - slow) * tanh(x) + slow * x / (1.0 + x * x) ** 0.5),)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Backlash is identifiable only where the torque changes sign."""
        if excitation.both_signs(excitation.torque[:, self.joint]):
            return None
        return "gravity's torque on it has (nearly) always the same sign: the play stays at one end"


class AxialPlay(LoadedJointEffect):
    """Axial play (end float) of a joint's bearing: the joint slides along its axis to the side that weight pulls to."""

    id = "axial_play"
    about = Description(
        cause="A shaft without a thrust bearing slides along its axis as far as collars and horn let it.",
        formula="δd = ½ b tanh(F/F0), F the weight along the axis",
        source="axial internal clearance, ISO 5593; smoothed as backlash",
        claim="{place} slides {b_mm} along its axis",
        needs="poses that tip the axis over: weight along it in both directions",
    )
    depends_on = ()
    extrapolation = Extrapolation.PROPORTIONAL
    parameters = (
        Parameter("b_mm", "axial play, from end to end", 0.001, lower=0.0),
        Parameter(
            "F0_N",
            "force that takes up 76 % of the play",
            0.5,
            lower=1e-3,
            fixed=0.5,
            scan=(0.05, 0.2, 0.5, 1.0, 3.0, 12.0),
        ),
    )

    @property
    def targets(self) -> tuple[str, ...]:
        """The offset along the joint's axis."""
        return (f"{self.place}.d",)

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """½ b tanh(F/F0)."""
        play, scale = p
        return (0.5 * play * tanh(tau[0] / scale),)


class Hysteresis(JointEffect, LinearEffect):
    """Hysteresis of one joint: the angle it stops at depends on the direction of approach."""

    id = "hysteresis"
    about = Description(
        cause=(
            "Friction and the servo's dead band let a joint stop a little early, so it depends on where it came from."
        ),
        formula="δq = ½ h · direction of the joint's last move",
        source="Slamani, Nubiola & Bonev 2012",
        claim="{place} stops {h_rad:apart, beyond its goal|apart, short of its goal} from either side",
        needs="measured order, and each joint approached from both sides",
    )
    depends_on = ("direction",)
    extrapolation = Extrapolation.PROPORTIONAL
    parameters = (Parameter("h_rad", "difference between the two approaches, of either sign", 0.02),)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Hysteresis is identifiable only if the joint was approached from both sides."""
        if excitation.poses.direction is None:
            return "the order of measurement is not known"
        if excitation.reversals(self.joint) < FEW_REVERSALS:
            return "the joint hardly ever reverses, so its direction of approach looks like its angle or the time"
        return None

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """½ direction; zero where the direction is unknown."""
        return ((0.5 * poses.approach(self.joint),),)
