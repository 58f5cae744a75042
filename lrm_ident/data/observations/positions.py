"""Measured positions of the TCP, as of a tracker."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Self

import numpy as np

from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.number_table import NumberTable
from lrm_ident.data.measurement_file.pose_quantity import (
    ABOVE_ZERO,
    DISTANCE,
    POINT,
    POSITION,
    SD,
    PoseQuantity,
    StatedQuantity,
)
from lrm_ident.data.observations.observation import Observation
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arm.plausible_arm import reach
from lrm_math.arrays import Array
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.sensed import TcpPosition
from lrm_math.plausibility import PlausibleSize

COORDINATE = PlausibleSize("a coordinate of a position", "mm", 0.0, 1e7)
FINEST = 1e-5
"""Share of the reach: no tracker that arms are measured with is so exact."""
TRACKER_SD = 0.3e-3
"""m: usual noise of a tracker per axis, where none is stated."""
BY_CHANCE = 1e-3
"""Probability up to which readings that are not rounded may all be multiples of a step."""
NM = 1e-9
"""m: finer than any reading is written."""


@dataclass(frozen=True, eq=False)
class Positions(Observation):
    """Positions (N, 3) of the TCP (m).

    `noise_sd`: standard deviation per axis for all poses, which does not weigh them against each other (m), or None.
    `model_sd`: standard deviation per axis by which a model misses them whatever their noise (m).
    """

    noise_sd: float | None = None
    model_sd: float = 0.0
    words = "positions"
    needs = "sd_mm or noise_sd_mm"
    is_length = True
    measurand = TcpPosition()
    quantities = (
        PoseQuantity("position", POSITION, size=COORDINATE, whole=True, required=True, unless=(DISTANCE, POINT)),
        PoseQuantity("sd", ("sd_mm",), ("sd", "std", "sigma"), ABOVE_ZERO, SD),
        PoseQuantity("sd_per_axis", ("sx_mm", "sy_mm", "sz_mm"), (), ABOVE_ZERO, SD),
        PoseQuantity("position_covariance", tuple(f"c{a}{b}_mm2" for a, b in combinations_with_replacement("xyz", 2))),
    )

    @classmethod
    def read(cls, table: NumberTable, beside: Metadata) -> Iterator[Self]:
        """Always; NaN where other things alone were measured."""
        values = table["position"] if "position" in table else np.full((len(table), 3), np.nan)
        noise = None if beside.noise_sd_mm is None else beside.noise_sd_mm * MM
        blocks = stated_blocks(table, "position_covariance", "sd_per_axis")
        yield cls(values, table.column("sd"), blocks, noise_sd=noise)

    def columns(self) -> Iterator[StatedQuantity]:
        """Their covariance, or one standard deviation each."""
        if len(self.rows):
            yield "position", self.values, 6
            i, j = np.triu_indices(3)
            yield ("sd", self.sd, 6) if self.blocks is None else ("position_covariance", self.blocks[:, i, j], 9)

    def doubts(self, arm: Arm) -> Iterator[str]:
        """Noise that no tracker has, or that is stated twice; a resolution coarser than the noise."""
        name, usual = ("noise_sd_mm", self.noise_sd or 0.0) if self.sd is None else ("sd_mm", float(np.median(self.sd)))
        if 0.0 < usual < FINEST * reach(arm):
            mm = usual / MM
            yield f"{name} is {mm:.3g} mm: no tracker is so exact; were it in metres, it would be {mm * 1e3:.3g} mm"
        if self.sd is not None and self.noise_sd is not None:
            yield "noise_sd_mm of the file beside the data is not used: column sd_mm says the noise of each position"
        yield from self.rounding_doubts()

    def rounding_doubts(self) -> Iterator[str]:
        """Readings that are rounded to more than the noise: an error of step/√12 (Bennett 1948)."""
        sd = self.weighed().rms_sd
        noise, whose = (TRACKER_SD, "that a tracker has") if sd is None else (float(np.nanmedian(sd)), "that is stated")
        errs = {axis: rounding_step(of) / math.sqrt(12.0) for axis, of in zip(POSITION, self.values.T, strict=True)}
        coarse = {axis: rounding for axis, rounding in errs.items() if rounding > noise}
        if coarse:
            rounding = max(coarse.values())
            what = f"all values of {', '.join(coarse)} are in steps of {math.sqrt(12.0) * rounding / MM:.3g} mm"
            yield (
                f"{what}; rounding errs by {rounding / MM:.2g} mm (SD), more than the noise {whose} "
                f"({noise / MM:.2g} mm): write more digits"
            )

    @property
    def covariance(self) -> Array:
        """With the model's error."""
        return super().covariance + self.model_sd**2 * np.eye(3)

    def weighed(self) -> Self:
        """With the noise that is the same for all."""
        sd_is_known = self.sd is not None or self.blocks is not None or self.noise_sd is None
        return self if sd_is_known else replace(self, sd=np.full(len(self.values), self.noise_sd))

    def residual(self, settled: Equilibrium) -> Array:
        """By coordinate (m)."""
        return np.asarray(self.values - settled.tcp)

    def shift(self, settled: Equilibrium) -> Array:
        """The residual."""
        return self.residual(settled)

    def turned(self, rotation: Array, translation: Array) -> Self:
        """Their coordinates in the other frame."""
        blocks = None if self.blocks is None else rotation @ self.blocks @ rotation.T
        return replace(self, values=self.values @ rotation.T + translation, blocks=blocks)


def rounding_step(values: Array) -> float:
    """Step of which all readings (N,), m or deg, are multiples, from the first one; 0: they show none.

    n differences of readings that are written finer are all multiples of a step by chance in at most 2⁻ⁿ of cases.
    """
    readings = np.unique(np.round(values[np.isfinite(values)] / NM).astype(np.int64))
    step = int(np.gcd.reduce(np.diff(readings), initial=0))
    return step * NM if 2.0 ** (1 - len(readings)) < BY_CHANCE else 0.0


def stated_blocks(table: NumberTable, covariance: str, sd: str) -> Array | None:
    """(N, 3, 3), covariances from their upper triangles or standard deviations; None if neither is stated."""
    if covariance not in table:
        return table[sd].reshape(len(table), -1, 1) ** 2 * np.eye(3) if sd in table else None
    out, (i, j) = np.empty((len(table), 3, 3)), np.triu_indices(3)
    out[:, i, j] = out[:, j, i] = table[covariance]
    return out
