"""Rotation matrices as rotation vectors and quaternions, in batches.

`scipy.spatial` takes half a second to load, and most measurements have no orientation: it is imported where it is used.
"""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array


def rotation_vectors(R: Array) -> Array:
    """(N, 3), axis times angle (rad) of rotations (N, 3, 3); NaN where the rotation is."""
    known = ~np.isnan(R[:, 0, 0])
    out = np.full((len(R), 3), np.nan)
    if known.any():
        from scipy.spatial.transform import Rotation

        out[known] = Rotation.from_matrix(R[known]).as_rotvec()
    return out


def quaternions(R: Array) -> Array:
    """(N, 4), unit quaternions w, x, y, z of rotations (N, 3, 3); NaN where the rotation is."""
    known = ~np.isnan(R[:, 0, 0])
    out = np.full((len(R), 4), np.nan)
    if known.any():
        from scipy.spatial.transform import Rotation

        out[known] = Rotation.from_matrix(R[known]).as_quat(canonical=True, scalar_first=True)
    return out
