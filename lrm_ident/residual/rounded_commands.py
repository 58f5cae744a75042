"""Joint angles that were written rounded: the error of the tip that this would make, if the servos got finer ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lrm_ident.data.observations.positions import rounding_step
from lrm_math.arrays import Array

AS_LARGE = 1.5
"""Ratio of two errors up to which one may be the other: both are known from some dozens of poses."""


@dataclass(frozen=True)
class RoundedCommands:
    """Angles that lie multiples of a `step` (rad) apart, and the RMS error of the tip (m) that rounding to it makes."""

    step: float
    tip: float

    def explains(self, error: float, noise: float) -> bool:
        """Whether an RMS error (m) that nothing predicts is as large, beyond the RMS noise (m), as rounding makes it.

        Whole degrees are often what was commanded: then the error is the noise, and rounding explains nothing.
        """
        excess = math.sqrt(max(error**2 - noise**2, 0.0))
        return self.tip > noise and self.tip / AS_LARGE < excess < self.tip * AS_LARGE


def rounded_commands(q: Array, J: Array) -> RoundedCommands | None:
    """The rounding of commanded angles q (N, n), rad; None where they show no step. J: (n, 3, M), ∂TCP/∂q (m/rad).

    Rounding errs evenly within a step, by step/√12 (Bennett 1948), in every joint by itself.
    """
    step = math.radians(rounding_step(np.degrees(q).reshape(-1)))
    if not step:
        return None
    return RoundedCommands(step, step / math.sqrt(12.0) * float(np.sqrt((J**2).sum(axis=(0, 1)).mean())))
