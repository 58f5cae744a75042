"""Self-heating: a servo that holds a load warms by its own losses, and its zero and scale follow."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_math.arrays import Array
from lrm_math.effects.base import Amounts, Description, Extrapolation, JointEffect, Parameter
from lrm_math.effects.memory.effect_with_memory import EffectWithMemory
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.history import Visits, differentiable, first_order_lag, lag_state
from lrm_math.kinematics.poses import Poses


class SelfHeating(EffectWithMemory, JointEffect):
    """Zero and gain of a servo that follow the heat of the load that it held: cold when a session begins."""

    id = "self_heating"
    depends_on = ("time", "angle")
    memories = 1
    extrapolation = Extrapolation.PROPORTIONAL
    about = Description(
        cause="A servo's losses grow with the square of the torque that it holds; as it warms, its angle drifts.",
        formula="δq = (a + g q) θ, T dθ/dt = τ² − θ, θ = 0 when a session begins",
        source="first-order thermal model of a motor's losses (Hughes & Drury 2019)",
        claim="{place} turns {a_rad_per_Nm2:forwards|backwards} as it warms under load",
        needs="the measured order, best with times (t_s), and loads that do not run with it",
    )
    parameters = (
        Parameter("a_rad_per_Nm2", "zero, in the long run", 0.05),
        Parameter("g_rad_per_rad_per_Nm2", "gain, in the long run", 0.05),
        Parameter("T_s", "thermal time constant", 600.0, 10.0, fixed=600.0, scan=(100.0, 200.0, 400.0, 800.0, 1600.0)),
    )

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """(a + g q) θ; nothing of a servo of which nobody knows what it held."""
        zero, gain, constant = p
        if poses.history is None:
            return (0.0,)
        visits = poses.history.visits
        held, [start] = self._losses(visits), self.began(visits)
        parts = differentiable(lambda slow: first_order_lag(visits, held, start, slow), constant)
        past, held_now = map(poses.history.own, parts)
        return ((zero + gain * poses.angle(self.joint)) * (past + held_now * poses.history.own(held)),)

    def memory(self, visits: Visits, p: Sequence[float]) -> tuple[Array, ...]:
        """θ (N²m²)."""
        [start] = self.began(visits)
        return (lag_state(visits, self._losses(visits), start, p[2]),)

    def _losses(self, visits: Visits) -> Array:
        """(M,), τ² at all visits (N²m²)."""
        return visits.loads(chain_of(self.arm), self.targets)[:, 0] ** 2
