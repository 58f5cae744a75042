"""Hidden effects of the measurement itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .hidden import Effect, Sight
from .rig import Vector
from .screws import Array, rotation


@dataclass(frozen=True)
class SkewTracker(Effect):
    """A tracker whose axes are turned, not at right angles, and of unequal units.

    turn_rad: rotation vector; stretch: excess length of x, y, z (0.003 is 0.3 %); lean_rad: angle by which y leans
    towards x, z towards x and z towards y. About the point centre_m, all in world axes.
    """

    turn_rad: Vector
    stretch: Vector
    lean_rad: Vector
    centre_m: Vector = (0.0, 0.0, 0.0)

    def seen_shift(self, sight: Sight) -> Array:
        """Stretch first, then lean, then turn."""
        yx, zx, zy = np.tan(self.lean_rad)
        lean = np.array([[1.0, yx, zx], [0.0, 1.0, zy], [0.0, 0.0, 1.0]])
        change = rotation(self.turn_rad) @ lean @ np.diag(1.0 + np.array(self.stretch)) - np.eye(3)
        return np.asarray((sight.tcp_m - np.array(self.centre_m)) @ change.T)
