"""Friction of a joint with memory and load: a refinement of hysteresis."""

from __future__ import annotations

from lrm_math.effects.backlash import Hysteresis
from lrm_math.effects.base import (
    Amounts,
    Description,
    Excitation,
    LinearEffect,
    LoadedJointEffect,
    Parameter,
    separately,
)
from lrm_math.effects.curves import TYPICAL
from lrm_math.kinematics.motion import TRAVELS_DEG
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import magnitude


class FrictionCurve(LoadedJointEffect, LinearEffect):
    """Friction that turns over along the way (several Dahl elements), and that grows with the load."""

    id = "friction_curve"
    variant_of = (Hysteresis.id,)
    depends_on = ("direction",)
    about = Description(
        cause="Friction gives way over a few degrees, not at once, and a loaded joint has more of it.",
        formula="δq = Σ c_i s_i + d · direction · |τ|, ds_i/dq = (direction − s_i)/travel_i, travel = 2, 8, 30°",
        source="Dahl 1968; several elements as in the model of Prandtl and Ishlinskii",
        claim="{place} has friction with a memory, or that grows with the load",
        needs="measured order, and short moves as well as long ones",
    )
    parameters = (
        *(Parameter(f"c_{travel}deg_rad", f"friction that turns over in {travel}°", TYPICAL) for travel in TRAVELS_DEG),
        Parameter("d_rad_per_Nm", "friction that grows with the torque", 0.02),
    )

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """The states, and direction · |τ|."""
        states = poses.friction_states(self.joint, len(TRAVELS_DEG))
        return separately([(*states, poses.approach(self.joint) * magnitude(tau[0]))])

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Needs what hysteresis needs."""
        return Hysteresis(self.arm, self.place).missing_excitation(excitation)
