"""Statistics of TCP errors: mean, RMS, maximum, SD."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array

CHI1_MEDIAN, CHI3_MEDIAN = 0.6744898, 1.5381724
"""Medians of the chi distribution with one and three degrees of freedom: of a number, and of a distance whose axes have
a deviation of 1."""


@dataclass(frozen=True)
class ErrorStats:
    """Mean, RMS, maximum and standard deviation over poses of the 3-D distance (m).

    `turn_rms`: RMS angle between measured and predicted orientation (rad), where orientations were measured.
    """

    mean: float
    rms: float
    max: float
    sd: float
    turn_rms: float | None = None

    def as_json(self) -> dict[str, float]:
        """Values in mm and deg."""
        turn = {} if self.turn_rms is None else {"turn_rms_deg": float(np.degrees(self.turn_rms))}
        return {f"{name}_mm": getattr(self, name) * 1e3 for name in ("mean", "rms", "max", "sd")} | turn


def error_stats(residual: Array, turn: Array | None = None) -> ErrorStats:
    """Statistics of a residual (N, 3) in m, and of rotation vectors (N, 3) in rad, NaN where not measured."""
    distance = np.linalg.norm(residual, axis=1)
    angle = np.array([]) if turn is None else np.linalg.norm(turn[~np.isnan(turn).any(axis=1)], axis=1)
    return ErrorStats(
        float(distance.mean()),
        float(np.sqrt((distance**2).mean())),
        float(distance.max()),
        float(distance.std()),
        float(np.sqrt((angle**2).mean())) if len(angle) else None,
    )
