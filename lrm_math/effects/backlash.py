"""Backlash and hysteresis of a joint: play, friction and dead band of its gears and servo."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_math.effects.base import FEW_REVERSALS, Amounts, Excitation, JointEffect, LoadedJointEffect, Parameter
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import tanh


class Backlash(LoadedJointEffect):
    """Backlash of one joint, taken up on the side that gravity pulls to."""

    id = "backlash"
    cause = "Gears have play; gravity pushes the joint to one end of it or, when the torque changes sign, the other."
    formula = "δq = ½ b tanh(τ/τ0)"
    source = "form after Slamani, Nubiola & Bonev 2012, smoothed at the change of sign"
    needs = "torque of both signs at the joint"
    parameters = (
        Parameter("b_rad", "play of the joint, from end to end", 0.02, lower=0.0),
        Parameter(
            "tau0_Nm",
            "torque that takes up 76 % of the play",
            0.02,
            1e-4,
            fixed=0.02,
            scan=(0.003, 0.01, 0.02, 0.04, 0.08, 0.2),
        ),
    )
    claim = "{place} has {b_rad} of play"
    follows_angles = False

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """½ b tanh(τ/τ0)."""
        return (0.5 * p[0] * tanh(tau[0] / p[1]),)

    def d_parameters(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """½ tanh(τ/τ0) and −½ b τ/τ0² sech²(τ/τ0)."""
        taken = tanh(tau[0] / p[1])
        return ((0.5 * taken,), (-0.5 * p[0] * tau[0] / p[1] ** 2 * (1.0 - taken**2),))

    def d_tau(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """½ b/τ0 sech²(τ/τ0)."""
        return ((0.5 * p[0] / p[1] * (1.0 - tanh(tau[0] / p[1]) ** 2),),)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Backlash is identifiable only where the torque changes sign."""
        if excitation.both_signs(excitation.torque[:, self.joint]):
            return None
        return f"gravity's torque on {self.place} has (nearly) always the same sign: the play stays at one end"


class Hysteresis(JointEffect):
    """Hysteresis of one joint: the angle it stops at depends on the direction of approach."""

    id = "hysteresis"
    cause = "Friction and the servo's dead band let a joint stop a little early, so it depends on where it came from."
    formula = "δq = ½ h · direction of the joint's last move"
    source = "Slamani, Nubiola & Bonev 2012"
    needs = "measured order, and each joint approached from both sides"
    parameters = (Parameter("h_rad", "difference between the two approaches, of either sign", 0.02),)
    claim = "{place} stops {h_rad} apart when it comes from one side or the other"
    follows_angles = False

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """½ h · direction; zero where the direction is unknown."""
        return (0.5 * p[0] * poses.approach(self.joint),)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Hysteresis is identifiable only if the joint was approached from both sides."""
        if excitation.poses.direction is None:
            return "the order of measurement is not known"
        if excitation.reversals(self.joint) < FEW_REVERSALS:
            never = f"{self.place} (nearly) never reverses"
            return f"{never}: the side that it comes from cannot be told from its angle or time"
        return None
