"""Reading before the arm has settled: each joint still lacks a share of its last move."""

from __future__ import annotations

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.effects.base import Amounts, Description, Excitation, Extrapolation, LinearEffect, Parameter
from lrm_math.effects.targets import FRAME_PLACE
from lrm_math.kinematics.poses import Poses


class SettlingError(LinearEffect):
    """Poses that were measured before the joints had come to rest: a fault of the measurement, not of the arm."""

    id = "settling_error"
    depends_on = ("session",)
    extrapolation = Extrapolation.PROPORTIONAL
    about = Description(
        cause="The tracker was read too early after a move: every joint was still short of its goal.",
        formula="δq_j = −e (q_j − q_j of the pose before) at every joint j",
        source="first-order settling of a position loop, read at a constant time (Franklin et al. 2019)",
        claim="{place} was read too early: {e_rad_per_rad:of each move was still to come|of each move went too far}",
        needs="the measured order, and moves that do not run with the angles",
    )
    parameters = (Parameter("e_rad_per_rad", "share of the last move that was still to come", 0.005, largest=1.0),)

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """The measurement, of all joints together."""
        return (FRAME_PLACE,)

    @property
    def targets(self) -> tuple[str, ...]:
        """The angle of every joint."""
        return tuple(f"{joint}.theta" for joint in self.arm.joint_names)

    @property
    def place_in_words(self) -> str:
        """All joints."""
        return "the arm"

    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """Minus the last move of each joint; nothing where the pose before is not known."""
        if poses.history is None:
            return ((0.0,) * self.arm.dof,)
        visits = poses.history.visits
        moves = np.diff(visits.q, axis=0, prepend=visits.q[:1])
        moves[visits.begins] = 0.0
        return (tuple(-poses.history.own(column) for column in moves.T),)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The order must be known."""
        return "the order of measurement is not known" if excitation.poses.history is None else None
