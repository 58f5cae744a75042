"""Wishes that are known before they come, so that each joint is commanded as much earlier as its servo is late."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_math.arrays import Array

SAME = 1e-4
"""rad: less than a tenth of an encoder's step; LeRobot's actions are float32."""


@dataclass(frozen=True, eq=False)
class PathAhead:
    """Announced wishes (N, n), rad, one each `period` s. `passed`: how many have come."""

    wishes: Array
    period: float
    passed: int = 0

    def after(self, wish: Array) -> PathAhead | None:
        """The path once the next wish (n,), rad, has come; None if it is another one, or the path is at its end."""
        if self.passed == len(self.wishes) or np.abs(self.wishes[self.passed] - wish).max() > SAME:
            return None
        return replace(self, passed=self.passed + 1)

    def led(self, delay: Array) -> Array:
        """(n,), rad, where the path is `delay` (n,), s, after the wish that came last; at its end it stays there.

        A command holds for a period, so it is late by half of one besides.
        """
        at = self.passed - 0.5 + delay / self.period
        steps = np.arange(len(self.wishes))
        return np.array([np.interp(x, steps, way) for x, way in zip(at, self.wishes.T, strict=True)])
