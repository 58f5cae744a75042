"""Statistics of TCP errors: mean, RMS, maximum, SD."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from lrm_math.arrays import Array

CHI1_MEDIAN, CHI3_MEDIAN = 0.6744898, 1.5381724
"""Medians of the chi distribution with one and three degrees of freedom: of a number, and of a distance whose axes have
a deviation of 1."""
WITHIN_95 = NormalDist().inv_cdf(0.975)
FEW_SQUARES = 20
"""Standard errors about an estimate that hold 95 %."""


@dataclass(frozen=True)
class ErrorStats:
    """Mean, RMS, maximum and standard deviation over poses of the 3-D distance (m).

    `turn_rms`: RMS angle between measured and predicted orientation (rad), where orientations were measured.
    `rms_between`: 95 % confidence interval of the RMS (m) at other poses that are drawn as these were, if the errors of
    poses are independent; None: of few poses.
    """

    mean: float
    rms: float
    max: float
    sd: float
    turn_rms: float | None = None
    rms_between: tuple[float, float] | None = None

    def as_json(self) -> dict[str, float]:
        """Values in mm and deg."""
        turn = {} if self.turn_rms is None else {"turn_rms_deg": float(np.degrees(self.turn_rms))}
        return {f"{name}_mm": getattr(self, name) * 1e3 for name in ("mean", "rms", "max", "sd")} | turn


def error_stats(residual: Array, turn: Array | None = None) -> ErrorStats:
    """Statistics of a residual (N, 3) in m, and of rotation vectors (N, 3) in rad, NaN where not measured."""
    distance = np.linalg.norm(residual, axis=1)
    angle = np.array([]) if turn is None else np.linalg.norm(turn[~np.isnan(turn).any(axis=1)], axis=1)
    squares = distance**2
    return ErrorStats(
        float(distance.mean()),
        float(np.sqrt(squares.mean())),
        float(distance.max()),
        float(distance.std()),
        float(np.sqrt((angle**2).mean())) if len(angle) else None,
        _rms_between(squares),
    )


def _rms_between(squares: Array) -> tuple[float, float] | None:
    """The interval of the root of a mean of independent squares (N,): its logarithm has Student's distribution (delta
    method). None of fewer than `FEW_SQUARES`, whose scatter tells too little of rare large ones."""
    mean, more = float(squares.mean()), len(squares) - 1
    if more + 1 < FEW_SQUARES or not mean:
        return None
    deviation = float(squares.std(ddof=1)) / math.sqrt(len(squares)) / mean
    student = WITHIN_95 * (1.0 + (WITHIN_95**2 + 1.0) / (4.0 * more))  # Abramowitz & Stegun 1964, 26.7.5
    apart, rms = math.exp(0.5 * student * deviation), math.sqrt(mean)
    return rms / apart, rms * apart
