"""Droop of a servo: its output shaft gives way before the encoder, which reads it."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_math.effects.base import Amounts, Excitation, LoadedJointEffect, Parameter
from lrm_math.kinematics.poses import Poses


class ServoDroop(LoadedJointEffect):
    """What a servo with a proportional controller yields under load; statically the same as a compliant joint."""

    id = "servo_droop"
    cause = (
        "A servo holds its angle like a spring: under load its shaft stands off the command, and its encoder reads it."
    )
    formula = "δq = k τ, before the encoder; `compliance` is what gives way behind it"
    source = "static error of proportional control (Franklin, Powell & Emami-Naeini, section 4.2)"
    claim = "the servo of {place} yields by {k_rad_per_Nm} before its encoder"
    needs = "joint feedback (q1_meas_deg …); without it, it is the same as compliance"
    parameters = (Parameter("k_rad_per_Nm", "compliance of the servo's control", 0.1, lower=0.0),)
    linear = True
    follows_angles = False
    before_encoder = True

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The joint's encoder must have been read."""
        if excitation.feedback:
            return None
        return f"without joint feedback (q1_meas_deg …) it is the same as compliance@{self.place}: one class"

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """k τ."""
        return (p[0] * tau[0],)

    def d_parameters(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """τ."""
        return ((tau[0],),)

    def d_tau(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """k."""
        return ((float(p[0]),),)
