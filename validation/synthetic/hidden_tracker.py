"""Hidden systematic errors of the measuring device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arm_description import Vector3
from .hidden_effect import HiddenEffect
from .screws import Array, rotation_matrix


@dataclass(frozen=True)
class SkewTracker(HiddenEffect):
    """Affine error of the tracker's frame: scale, then non-orthogonal axes, then rotation.

    turn_rad: rotation vector; stretch: scale errors of x, y, z (0.003 is 0.3 %); lean_rad: shear angles of y towards x,
    z towards x and z towards y. About the point centre_m, all in world axes.
    """

    turn_rad: Vector3
    stretch: Vector3
    lean_rad: Vector3
    centre_m: Vector3 = (0.0, 0.0, 0.0)

    def measurement_error(self, tcp_m: Array) -> Array:
        """The affine error of each position (P, 3) in m."""
        yx, zx, zy = np.tan(self.lean_rad)
        shear = np.array([[1.0, yx, zx], [0.0, 1.0, zy], [0.0, 0.0, 1.0]])
        change = rotation_matrix(self.turn_rad) @ shear @ np.diag(1.0 + np.array(self.stretch)) - np.eye(3)
        return np.asarray((tcp_m - np.array(self.centre_m)) @ change.T)
