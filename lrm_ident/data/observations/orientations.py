"""Measured orientations of the tool, whose errors may be correlated with those of its position."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Self

import numpy as np

from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.number_table import NumberTable
from lrm_ident.data.measurement_file.pose_quantity import (
    ABOVE_ZERO,
    QUATERNION,
    TURN_SD,
    NumberRule,
    PoseQuantity,
    StatedQuantity,
)
from lrm_ident.data.observations.observation import Observation
from lrm_ident.data.observations.positions import stated_blocks
from lrm_ident.data.rigid_motion import quaternions, rotation_matrix, rotation_vectors
from lrm_math.arrays import Array
from lrm_math.kinematics.forward import ChainGeometry
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.sensed import Measurand, Sensed, TcpPosition, tool_rotation

UNIT_LENGTH = NumberRule(
    lambda values: np.abs(np.linalg.norm(values, axis=1, keepdims=True) - 1.0) > 0.01,
    "the quaternion's length is not one",
)
TURNS = "uvw"
"""Coordinates of the error of an orientation: its rotation vector about x, y, z (deg)."""


@dataclass(frozen=True)
class ToolOrientation(Measurand):
    """Orientation of the tool: small turns as a rotation vector in world axes (rad)."""

    name = "orientation"

    def by_slots(self, settled: Equilibrium, geometry: ChainGeometry, tcp: Array) -> Array:
        """The axes of the slots that rotate."""
        return np.where(settled.model.chain.rotates[:, None, None], geometry.axis, 0.0)


POSE = Sensed((TcpPosition(), ToolOrientation()))
"""Position and orientation."""


@dataclass(frozen=True, eq=False)
class Orientations(Observation):
    """Rotations (N, 3, 3) of the tool's frame; its numbers are the rotation vector of their error (rad)."""

    words = "orientations"
    needs = "srot_deg"
    measurand = ToolOrientation()
    quantities = (
        PoseQuantity("cross_covariance", tuple(f"c{a}{u}_mmdeg" for a in "xyz" for u in TURNS)),
        PoseQuantity("turn_covariance", tuple(f"c{u}{w}_deg2" for u, w in combinations_with_replacement(TURNS, 2))),
        PoseQuantity("turn_sd", ("srot_deg",), (), ABOVE_ZERO, TURN_SD),
        PoseQuantity("quaternion", QUATERNION, (), UNIT_LENGTH, may_be_empty=True, whole=True),
    )

    @classmethod
    def read(cls, table: NumberTable, beside: Metadata) -> Iterator[Self]:
        """From quaternions."""
        if "quaternion" in table:
            q = table["quaternion"]
            crossed = table["cross_covariance"] if "cross_covariance" in table else np.zeros((len(table), 9))
            rotations = rotation_matrix(q / np.linalg.norm(q, axis=1, keepdims=True))
            blocks = stated_blocks(table, "turn_covariance", "turn_sd")
            yield cls(rotations, None, blocks, crossed.reshape(-1, 3, 3).transpose(0, 2, 1))

    def columns(self) -> Iterator[StatedQuantity]:
        """With their covariance or standard deviation, where it is stated."""
        if self.blocks is None:
            yield "turn_sd", self.sd, 6
        else:
            i, j = np.triu_indices(3)
            crossed = np.broadcast_to(self.cross, self.blocks.shape).transpose(0, 2, 1)
            yield "cross_covariance", crossed.reshape(-1, 9), 9
            yield "turn_covariance", self.blocks[:, i, j], 9
        yield "quaternion", quaternions(self.values), 9

    @property
    def numbers(self) -> Array:
        """A column of each rotation."""
        return self.values[:, :, 0]

    def residual(self, settled: Equilibrium) -> Array:
        """Rotation vectors from the predicted to the measured orientation (rad)."""
        return rotation_vectors(self.values @ tool_rotation(settled).transpose(0, 2, 1))

    def turn(self, settled: Equilibrium) -> Array:
        """The residual."""
        return self.residual(settled)

    def turned(self, rotation: Array, translation: Array) -> Self:
        """In the other frame's axes."""
        blocks = None if self.blocks is None else rotation @ self.blocks @ rotation.T
        cross = rotation @ np.broadcast_to(self.cross, self.values.shape) @ rotation.T
        return replace(self, values=rotation @ self.values, blocks=blocks, cross=cross)
