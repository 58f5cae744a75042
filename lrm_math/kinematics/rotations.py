"""Rotation matrices about coordinate axes."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.chain import PLANE


def rotation_about(axis: int, angle: float) -> Array:
    """(3, 3), rotation by an angle (rad) about the axis x, y or z (0, 1, 2)."""
    out, (i, j) = np.eye(3), PLANE[axis]
    out[i, i] = out[j, j] = np.cos(angle)
    out[j, i] = np.sin(angle)
    out[i, j] = -out[j, i]
    return out
