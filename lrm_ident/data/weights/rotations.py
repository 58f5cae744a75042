"""Rotation matrices as rotation vectors and quaternions, in batches.

`scipy.spatial` takes half a second to load, and most measurements have no orientation: it is imported where it is used.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from lrm_math.arrays import Array

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


def rotation_vectors(R: Array) -> Array:
    """(N, 3), axis times angle (rad) of rotations (N, 3, 3); NaN where the rotation is."""
    return _where_known(R, 3, lambda rotation: rotation.as_rotvec())


def quaternions(R: Array) -> Array:
    """(N, 4), unit quaternions w, x, y, z of rotations (N, 3, 3); NaN where the rotation is."""
    return _where_known(R, 4, lambda rotation: rotation.as_quat(canonical=True, scalar_first=True))


def _where_known(R: Array, size: int, numbers: Callable[[Rotation], Array]) -> Array:
    known = ~np.isnan(R[:, 0, 0])
    out = np.full((len(R), size), np.nan)
    if known.any():
        from scipy.spatial.transform import Rotation

        out[known] = numbers(Rotation.from_matrix(R[known]))
    return out


def rotation_matrix(q: Array) -> Array:
    """(..., 3, 3), rotations of unit quaternions w, x, y, z (..., 4)."""
    K = skew(q[..., 1:])
    return np.asarray(np.eye(3) + 2.0 * q[..., :1, None] * K + 2.0 * K @ K)


def skew(v: Array) -> Array:
    """(..., 3, 3), matrices K of vectors (..., 3) with K u = v × u."""
    x, y, z = np.moveaxis(np.asarray(v, dtype=np.float64), -1, 0)
    o = np.zeros_like(x)
    return np.moveaxis(np.array([[o, -z, y], [z, o, -x], [-y, x, o]]), (0, 1), (-2, -1))


def turned_covariance(covariance: Array, rotation: Array) -> Array:
    """(N, 6, 6), covariances of position and rotation vector in axes turned by (3, 3); NaN stays where it stands."""
    both = np.kron(np.eye(2), rotation)
    return np.where(np.isnan(covariance), np.nan, both @ np.nan_to_num(covariance) @ both.T)
