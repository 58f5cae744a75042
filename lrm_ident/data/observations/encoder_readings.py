"""Readings of the joints' encoders: commands, and what gives way before the encoder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.number_table import NumberTable
from lrm_ident.data.measurement_file.pose_quantity import StatedQuantity
from lrm_ident.data.observations.observation import Observation
from lrm_math.arrays import Array
from lrm_math.effects.targets import Kind
from lrm_math.kinematics.forward import ChainGeometry
from lrm_math.model.effect_binding import BoundEffect
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.sensed import Column, Measurand, encoder_angles


@dataclass(frozen=True)
class EncoderAngles(Measurand):
    """Angles that the joints' encoders read (rad), one row for each joint."""

    name = "feedback"

    def rows(self, dof: int) -> int:
        """One for each joint."""
        return dof

    def by_slots(self, settled: Equilibrium, geometry: ChainGeometry, tcp: Array) -> Array:
        """Zero: they do not see what moves behind them."""
        return np.zeros((len(tcp), settled.model.chain.dof, tcp.shape[2]))

    def add_direct(self, columns: Sequence[Column], bound: BoundEffect, settled: Equilibrium) -> None:
        """Motions of a servo's shaft."""
        if bound.kind is Kind.MOTION:
            for out, amounts in columns:
                for encoder, amount in zip(bound.encoders, amounts, strict=True):
                    if encoder is not None:
                        out[encoder] += amount


@dataclass(frozen=True, eq=False)
class EncoderReadings(Observation):
    """What the encoders of n joints read, (N, n) in rad; NaN where one did not."""

    words = "joint feedback"
    needs = "feedback_sd_deg"
    measurand = EncoderAngles()

    @classmethod
    def read(cls, table: NumberTable, beside: Metadata) -> Iterator[Self]:
        """From q1_meas_deg …; an encoder that counts from 0 to 360 deg is read in the turn of the command."""
        if "feedback" in table:
            read, turn, sd = table["feedback"], 2.0 * np.pi, beside.feedback_sd_deg
            values = read + turn * np.round((table["angles"] - read) / turn)
            yield cls(values, None if sd is None else np.full(len(table), np.radians(sd)))

    def columns(self) -> Iterator[StatedQuantity]:
        """The readings."""
        yield "feedback", self.values, 6

    def residual(self, settled: Equilibrium) -> Array:
        """By joint (rad)."""
        return self.values - encoder_angles(settled)
