"""The four numbers that every error is reported by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array


@dataclass(frozen=True)
class ErrorFigures:
    """Mean, RMS, maximum and standard deviation over poses of the 3-D distance (m)."""

    mean: float
    rms: float
    max: float
    sd: float

    def as_json(self) -> dict[str, float]:
        """The same in mm."""
        return {f"{name}_mm": value * 1e3 for name, value in vars(self).items()}


def figures(residual: Array) -> ErrorFigures:
    """Figures of a residual (N, 3) in m."""
    distance = np.linalg.norm(residual, axis=1)
    return ErrorFigures(
        float(distance.mean()), float(np.sqrt((distance**2).mean())), float(distance.max()), float(distance.std())
    )
