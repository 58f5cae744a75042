"""Measured distances of the TCP from a fixed point.

They are those of a string potentiometer, or of a telescoping ball bar; positions may be missing beside them.
Goswami, Quaid & Peshkin 1993 (ball bar); Driels & Swayze 1994 (single wire draw).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.number_table import NumberTable
from lrm_ident.data.measurement_file.pose_quantity import ABOVE_ZERO, DISTANCE, SD, PoseQuantity, StatedQuantity
from lrm_ident.data.observations.observation import Observation
from lrm_ident.data.registration.anchor import with_anchor
from lrm_ident.data.source import Source
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.effects.targets import Kind
from lrm_math.kinematics.forward import ChainGeometry
from lrm_math.kinematics.poses import Poses
from lrm_math.model.effect_binding import BoundEffect, anchor_shift
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model
from lrm_math.model.sensed import Column, Measurand

ORIGIN = (0.0, 0.0, 0.0)
LENGTHS = ("distance", "dist", "wire", "string", "ballbar")


@dataclass(frozen=True)
class PointDistance(Measurand):
    """Distance (m) of the TCP from a fixed point: the stated one (m), and what effects add to it."""

    point: tuple[float, float, float] = ORIGIN
    name = "distance"

    def rows(self, dof: int) -> int:
        """One."""
        return 1

    def line(self, settled: Equilibrium) -> Array:
        """(N, 3), from the point to the TCP (m)."""
        point = np.array(self.point)
        for bound in settled.model.binding.anchoring:
            point = point + anchor_shift(bound.effect, bound.at(settled.poses))
        return np.asarray(settled.true_tcp - point)

    def _along(self, settled: Equilibrium) -> Array:
        """(N, 3), unit vectors from the point to the TCP."""
        line = self.line(settled)
        return np.asarray(line / np.linalg.norm(line, axis=1, keepdims=True))

    def by_slots(self, settled: Equilibrium, geometry: ChainGeometry, tcp: Array) -> Array:
        """The TCP's motion along the line."""
        return np.asarray(np.einsum("nc,scn->sn", self._along(settled), tcp)[:, None])

    def add_direct(self, columns: Sequence[Column], bound: BoundEffect, settled: Equilibrium) -> None:
        """A shift of the point: the distance falls where it comes nearer to the TCP."""
        if bound.kind is Kind.ANCHOR:
            along = self._along(settled)
            for out, amounts in columns:
                out[0] -= along @ anchor_shift(bound.effect, amounts)


@dataclass(frozen=True, eq=False)
class Distances(Observation):
    """Distances (N,) of the TCP (m); `start`: the point that they are measured from (m), or None: not known."""

    start: tuple[float, float, float] | None = None
    words = "distances"
    needs = "distance_sd_mm"
    is_length = True
    quantities = (
        PoseQuantity("distance", (DISTANCE,), LENGTHS, ABOVE_ZERO, may_be_empty=True),
        PoseQuantity("distance_sd", ("distance_sd_mm",), ("distancesd",), ABOVE_ZERO, SD),
    )

    @classmethod
    def read(cls, table: NumberTable, beside: Metadata) -> Iterator[Self]:
        """From distance_mm, and the metadata."""
        if "distance" in table:
            sd, start = table.column("distance_sd"), beside.distance_from_mm
            if sd is None and beside.distance_sd_mm is not None:
                sd = np.full(len(table), beside.distance_sd_mm * MM)
            point = None if start is None else (start[0] * MM, start[1] * MM, start[2] * MM)
            yield cls(table["distance"][:, 0], sd, start=point)

    def columns(self) -> Iterator[StatedQuantity]:
        """With their standard deviation."""
        yield "distance", self.values, 6
        yield "distance_sd", self.sd, 6

    def doubts(self, arm: Arm) -> Iterator[str]:
        """An end that is not known."""
        if self.start is None:
            yield "where distances are measured from is not stated (distance_from_mm): it is estimated"

    def set_up(self, model: Model, poses: Poses, source: Source) -> Model:
        """Where they start."""
        return model if self.start is not None else with_anchor(model, poses, self.values, source)

    @property
    def measurand(self) -> PointDistance:
        """From the stated point; else from the one that the model's anchor says."""
        return PointDistance(self.start or ORIGIN)

    def residual(self, settled: Equilibrium) -> Array:
        """Along the line (m)."""
        return np.asarray(self.values - np.linalg.norm(self.measurand.line(settled), axis=1))[:, None]

    def shift(self, settled: Equilibrium) -> Array:
        """The residual along the line."""
        line = self.measurand.line(settled)
        length = np.linalg.norm(line, axis=1)
        return np.asarray(((self.values - length) / length)[:, None] * line)

    def turned(self, rotation: Array, translation: Array) -> Self:
        """From the point in the other frame."""
        if self.start is None:
            return self
        x, y, z = (rotation @ np.array(self.start) + translation).tolist()
        return replace(self, start=(x, y, z))
