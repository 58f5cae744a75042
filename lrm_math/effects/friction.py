"""Friction of a joint with memory and load: a refinement of hysteresis."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
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
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import magnitude

TRAVELS_DEG = (2, 8, 30)
"""Moves after which each element of friction has turned over by 63 %."""


def friction_states(q: Array, moves: Array, start: Array | None) -> Array:
    """(N, n, K), state −1 … 1 of an element of Dahl friction for each travel, after the moves from pose to pose.

    Each state obeys ds/dq = (sign(dq) − s)/travel along straight moves (Dahl 1968, exponent 1), and begins with the
    first move turned over.

    Args:
        q: (N, n), commanded angles in the measured order (rad).
        moves: (N, n), sign of each joint's last move, 0 where that is not known.
        start: (n,), angles before the first pose, if known.
    """
    lengths = np.abs(np.diff(q, axis=0, prepend=q[:1] if start is None else np.asarray(start)[None]))
    lengths[moves == 0.0] = np.inf  # where the last move is not known, nor is what was before it
    states = np.repeat(moves[:, :, None], len(TRAVELS_DEG), axis=2)
    for row in range(1, len(q)):
        states[row] = turned_over(states[row - 1], lengths[row], moves[row])
    return states


def turned_over(states: Array, lengths: Array, side: Array) -> Array:
    """(n, K), states (n, K) after straight moves of the joints by `lengths` (n,), rad, towards `side` (n,)."""
    kept = np.exp(-lengths[:, None] / np.radians(TRAVELS_DEG))
    return np.asarray(side[:, None] + kept * (states - side[:, None]))


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
