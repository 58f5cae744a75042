"""Measured quantities of a pose beside the TCP's position: rows of its derivative, and what encoders read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from lrm_math.arrays import Array
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import Poses
from lrm_math.model.effect_binding import anchor_shift
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model


@dataclass(frozen=True)
class Sensed:
    """Rows of each pose: the TCP's position (3), its `attitude` (3), every joint's `feedback` (n), its distance (1).

    `distance_from`: point from which the last one is measured as far as it is stated (m), else the origin; None: none.
    """

    attitude: bool = False
    feedback: bool = False
    distance_from: tuple[float, float, float] | None = None

    def rows(self, dof: int) -> int:
        """Number of rows R of one pose."""
        return 3 + 3 * self.attitude + dof * self.feedback + (self.distance_from is not None)

    @property
    def first_feedback(self) -> int:
        """Row of the first joint's feedback, if there is one."""
        return 3 + 3 * self.attitude


TCP_ONLY = Sensed()


def encoder_angles(settled: Equilibrium) -> Array:
    """(N, n), what joint encoders read (rad): the command, and what effects before the encoder add to it.

    What gives way behind an encoder, between it and the link, it does not see.
    """
    return settled.poses.q + before_encoders(settled.model, settled.poses, settled.tau)


def before_encoders(model: Model, poses: Poses, tau: Sequence[Number]) -> Array:
    """(N, n), what effects add to the joints before their encoders (rad); `tau`: loads on `model.load_slots` (N·m)."""
    out = np.zeros_like(poses.q)
    for bound in (*model.binding.rigid, *model.binding.elastic):
        if any(encoder is not None for encoder in bound.encoders):
            for encoder, (_, amount) in zip(bound.encoders, bound.amounts(poses, tau), strict=True):
                if encoder is not None:
                    out[:, encoder] += amount
    return out


def tool_rotation(settled: Equilibrium) -> Array:
    """(N, 3, 3), rotation of the tool's frame."""
    return frames(settled.model.chain, settled.slots, len(settled.poses))[:, -1, :3, :3]


def from_anchor(settled: Equilibrium, stated: ArrayLike) -> Array:
    """(N, 3), TCP less the fixed point of measured distances (m): the stated one, and what effects add to it."""
    point = np.asarray(stated, dtype=np.float64)
    for bound in settled.model.binding.anchoring:
        point = point + anchor_shift(bound.effect, bound.at(settled.poses))
    return np.asarray(settled.true_tcp - point)


def along_distance(settled: Equilibrium, stated: ArrayLike) -> Array:
    """(N, 3), unit vectors from that point to the TCP."""
    line = from_anchor(settled, stated)
    return np.asarray(line / np.linalg.norm(line, axis=1, keepdims=True))
