"""Noise floor of the measurements: by repeated poses, or as their file states it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array
from lrm_math.model.equilibrium import Equilibrium


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of the measurements: standard deviation `sd` per axis (m), or None, and its `source`.

    `axes`: number of measured axes of a position, three unless distances alone were measured.
    `degrees_of_freedom`: of `sd` as an estimate; infinite where a file states it.
    """

    sd: float | None
    source: Literal["replicates", "metadata", "unknown"]
    axes: float = 3.0
    degrees_of_freedom: float = np.inf

    @property
    def rms(self) -> float | None:
        """RMS of the 3-D distance that the noise alone makes (m)."""
        return None if self.sd is None else float(np.sqrt(self.axes) * self.sd)

    @property
    def interval(self) -> tuple[float, float] | None:
        """95 % confidence interval of `rms` (m) by the χ² distribution of repeated poses; None where it is stated."""
        from scipy.special import chdtri

        if self.rms is None or np.isinf(self.degrees_of_freedom):
            return None
        low, high = (
            self.rms * float(np.sqrt(self.degrees_of_freedom / chdtri(self.degrees_of_freedom, tail)))
            for tail in (0.025, 0.975)
        )
        return low, high

    def error_without(self, rms: float, poses: int) -> tuple[float, float] | None:
        """Bounds (m) of the RMS error that is left of a held-out one of so many poses without this noise; None where
        the noise is not known.

        Mean squares subtract. Each bound holds with 95 % for normal errors, whose squares follow a χ² distribution;
        the noise is at the end of its `interval`.
        """
        from scipy.special import chdtri

        if self.rms is None:
            return None
        numbers = self.axes * poses
        least, most = self.interval or (self.rms, self.rms)
        low = rms**2 * numbers / chdtri(numbers, 0.05) - most**2
        high = rms**2 * numbers / chdtri(numbers, 0.95) - least**2
        return float(np.sqrt(max(0.0, low))), float(np.sqrt(max(0.0, high)))

    def p_value(self, sigma: float, degrees_of_freedom: float) -> float:
        """p value of the lack-of-fit F test of a residual (m per axis) (Draper and Smith 1998, section 2.1).

        With replicates the pure error is subtracted from the residual's squares, and the rest compared with it; with a
        stated noise this becomes the χ² test. NaN where the noise is unknown.
        """
        from scipy.special import chdtrc, fdtrc  # here: a fit compares its error with the noise, and loads no scipy

        if self.sd is None:
            return np.nan
        ratio, pure = (sigma / self.sd) ** 2, self.degrees_of_freedom
        if np.isinf(pure):
            return float(chdtrc(degrees_of_freedom, degrees_of_freedom * ratio))
        lack = degrees_of_freedom - pure
        return float(fdtrc(lack, pure, max(0.0, (degrees_of_freedom * ratio - pure) / lack))) if lack > 0 else 1.0


def noise_floor(data: Measurements, equilibrium: Equilibrium, explained: Array | float = 0.0) -> NoiseFloor:
    """Noise of the measurements: pooled standard deviation of a model's residuals at repeated poses (pure error, Draper
    and Smith 1998, section 2.1), else as the file states it, else unknown.

    Residuals are taken, not positions, since a repetition from the other side or under another load differs by what the
    model knows of friction and springs. Repetitions that are all equal to the last digit were copied, and do not count.

    Args:
        explained: (N, R), what an effect that the model lacks would explain of the residuals.
    """
    measured, rows = data.first.numbers, data.first.rows
    axes = measured.shape[1]
    unexplained = (data.residual(equilibrium) - explained)[:, data.rows_of(data.first)]
    numbers, count = np.unique(data.repeat_of[rows], return_counts=True)
    repeats = [rows[data.repeat_of[rows] == number] for number in numbers[count > 1]]
    if any(np.ptp(measured[rows], axis=0).any() for rows in repeats):
        squares = sum(float(((unexplained[rows] - unexplained[rows].mean(axis=0)) ** 2).sum()) for rows in repeats)
        degrees_of_freedom = axes * sum(len(rows) - 1 for rows in repeats)
        return NoiseFloor(float(np.sqrt(squares / degrees_of_freedom)), "replicates", axes, degrees_of_freedom)
    if data.sd is not None:
        return NoiseFloor(float(np.sqrt(np.mean(data.sd**2))), "metadata", axes)
    noise = data.positions.noise_sd
    return NoiseFloor(noise, "unknown" if noise is None else "metadata", axes)
