"""Play and friction in the gears of a joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lrm_math.effects.base import (
    FEW_REVERSALS,
    Amounts,
    Evidence,
    JointEffect,
    LoadedJointEffect,
    Parameter,
)
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import tanh


@dataclass(frozen=True)
class Backlash(LoadedJointEffect):
    """Play of one joint, taken up on the side that gravity pulls to."""

    id = "backlash"
    cause = "Gears have play; gravity pushes the joint to one end of it or, when the torque changes sign, the other."
    formula = "δq = ½ b tanh(τ/τ0)"
    source = "form after Slamani, Nubiola & Bonev 2012, smoothed at the change of sign"
    needs = "torque of both signs at the joint"
    claim = "{place} has {b_rad} of play"
    follows_angles = False

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The whole play b, and the torque τ0 at which three quarters of it are taken up."""
        return (
            Parameter("b_rad", f"play of {self.place}, from end to end", 0.02, lower=0.0),
            Parameter(
                "tau0_Nm",
                "torque that takes up 76 % of the play",
                0.02,
                lower=1e-4,
                fixed=0.02,
                scan=(0.003, 0.01, 0.02, 0.04, 0.08, 0.2),
            ),
        )

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

    def why_not(self, evidence: Evidence) -> str | None:
        """Play shows where the torque changes sign."""
        if evidence.both_signs(evidence.torque[:, self.joint]):
            return None
        return f"gravity's torque on {self.place} has (nearly) always the same sign: the play stays at one end"


@dataclass(frozen=True)
class Hysteresis(JointEffect):
    """A joint that stops a little short, on the side it comes from."""

    id = "hysteresis"
    cause = "Friction and the servo's dead band let a joint stop a little early, so it depends on where it came from."
    formula = "δq = ½ h · direction of the joint's last move"
    source = "Slamani, Nubiola & Bonev 2012"
    needs = "measured order, and each joint approached from both sides"
    claim = "{place} stops {h_rad} apart when it comes from one side or the other"
    follows_angles = False

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The difference h between the two approaches, of either sign (a servo may overshoot)."""
        return (Parameter("h_rad", f"difference between the two approaches of {self.place}", 0.02),)

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """½ h · direction; zero where the direction is unknown."""
        return (0.5 * p[0] * poses.approach(self.joint),)

    def why_not(self, evidence: Evidence) -> str | None:
        """It shows only if the joint came from both sides."""
        if evidence.poses.direction is None:
            return "the order of measurement is not known"
        if evidence.reversals(self.joint) >= FEW_REVERSALS:
            return None
        return (
            f"{self.place} (nearly) never reverses: the side that it comes from cannot be told from its angle or time"
        )
