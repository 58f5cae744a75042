"""Quantities of a pose that instruments measure: the rows of its derivatives, the TCP's position first."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.base import Amounts
from lrm_math.effects.targets import Kind
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.dual import Dual
from lrm_math.kinematics.forward import ChainGeometry, frames
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import linear_combination
from lrm_math.model.effect_binding import BoundEffect, distortion, frame_basis
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model

Column = tuple[Array, Amounts]
"""A column of derivatives (k, N) to add to, and the amounts at an effect's targets for one unit of its parameter."""


class Measurand(ABC):
    """A quantity of a pose that can be measured: k rows of derivatives.

    Subclasses are frozen dataclasses: a response is kept for the measurands that it is of. `name`: as effects that need
    it say it.
    """

    name: ClassVar[str]

    def rows(self, dof: int) -> int:
        """Number k of its rows at one pose of an arm with so many joints."""
        return 3

    @abstractmethod
    def by_slots(self, settled: Equilibrium, geometry: ChainGeometry, tcp: Array) -> Array:
        """(S, k, N), derivatives by a motion of each slot alone, rigid arm; `tcp`: (S, 3, N), those of the TCP."""

    def add_direct(self, columns: Sequence[Column], bound: BoundEffect, settled: Equilibrium) -> None:  # noqa: B027
        """Adds to each column what an effect does to the quantity beside moving the arm; nothing by default."""


@dataclass(frozen=True)
class TcpPosition(Measurand):
    """Position of the TCP (m), in the distorted frame of its tracker."""

    name = "position"

    def by_slots(self, settled: Equilibrium, geometry: ChainGeometry, tcp: Array) -> Array:
        """The TCP's own."""
        if not settled.model.binding.distorting:
            return tcp
        return np.asarray(np.einsum("dcn,scn->sdn", _distortion_derivatives(settled), tcp))

    def add_direct(self, columns: Sequence[Column], bound: BoundEffect, settled: Equilibrium) -> None:
        """What distorts the frame, or moves it."""
        if bound.kind is Kind.FRAME:
            basis = frame_basis(bound, list(settled.true_tcp.T))
            for out, amounts in columns:
                for component, amount in zip(out, linear_combination(amounts, basis, 3), strict=True):
                    component += amount


@dataclass(frozen=True)
class Sensed:
    """What is measured of each pose, in the order of its rows R; the TCP's position first."""

    measurands: tuple[Measurand, ...] = (TcpPosition(),)

    def rows(self, dof: int) -> int:
        """Number of rows R of one pose."""
        return sum(measurand.rows(dof) for measurand in self.measurands)

    def spans(self, dof: int) -> list[tuple[Measurand, slice]]:
        """Each measurand, and its rows."""
        end = 0
        return [(measurand, slice(end, end := end + measurand.rows(dof))) for measurand in self.measurands]

    @property
    def names(self) -> frozenset[str]:
        """Names of what is measured."""
        return frozenset(measurand.name for measurand in self.measurands)


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


def _distortion_derivatives(settled: Equilibrium) -> Array:
    """(3, 3, N), ∂(measured TCP)/∂TCP in the tracker's distorted frame."""
    by_position = np.repeat(np.eye(3)[:, :, None], len(settled.poses), axis=2)
    # forward-mode differentiation (dual numbers) through the tracker's effects, one after the other
    moving = [Dual(x, slope) for x, slope in zip(settled.true_tcp.T, by_position.copy(), strict=True)]
    for bound in settled.model.binding.distorting:
        added = distortion(bound, bound.at(settled.poses), moving)  # type: ignore[arg-type]
        for row, amount in enumerate(added):
            if isinstance(amount, Dual):
                by_position[row] += amount.slope
    return by_position
