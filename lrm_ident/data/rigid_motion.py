"""Rotations in batches, and rigid motions (4, 4) from the numbers that robot descriptions use; m and rad.

`scipy.spatial` takes half a second to load, and most measurements have no orientation: it is imported where it is used.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lrm_math.arm.arm import Placement
from lrm_math.arrays import Array

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

GIMBAL = 1e-12
"""Cosine of the pitch below which roll and yaw are one angle; near it the last one is what the first one leaves."""


def rotation_vectors(R: Array) -> Array:
    """(N, 3), axis times angle (rad) of rotations (N, 3, 3); NaN where the rotation is."""
    return _where_known(R, 3, lambda rotation: rotation.as_rotvec())


def quaternions(R: Array) -> Array:
    """(N, 4), unit quaternions w, x, y, z of rotations (N, 3, 3); NaN where the rotation is."""
    return _where_known(R, 4, lambda rotation: rotation.as_quat(canonical=True, scalar_first=True))


def _where_known(R: Array, size: int, numbers: Callable[[Rotation], Array]) -> Array:
    is_known = ~np.isnan(R[:, 0, 0])
    out = np.full((len(R), size), np.nan)
    if is_known.any():
        from scipy.spatial.transform import Rotation

        out[is_known] = numbers(Rotation.from_matrix(R[is_known]))
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


def turn(axis: Sequence[float], angle: float) -> Array:
    """(4, 4), rotation about a unit axis (Rodrigues' formula), rad."""
    K, out = skew(np.array(axis)), np.eye(4)
    out[:3, :3] += math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K
    return out


def shift(vector: Sequence[float]) -> Array:
    """(4, 4), translation (m)."""
    out = np.eye(4)
    out[:3, 3] = vector
    return out


def homogeneous(R: Array, t: Array) -> Array:
    """(4, 4), rotation R (3, 3) and then translation t (3,), m."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = R, np.asarray(t).ravel()
    return out


def inverse(T: Array) -> Array:
    """(4, 4), inverse of a rigid motion."""
    return homogeneous(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])


def from_xyz_rpy(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    """(4, 4), URDF's `<origin>`: translation, then Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = rpy
    return shift(xyz) @ turn((0, 0, 1), yaw) @ turn((0, 1, 0), pitch) @ turn((1, 0, 0), roll)


def to_xyz_rpy(T: Array) -> tuple[list[float], list[float]]:
    """The inverse of `from_xyz_rpy`."""
    R = T[:3, :3]
    flat = math.hypot(R[0, 0], R[1, 0])
    yaw = math.atan2(R[1, 0], R[0, 0]) if flat >= GIMBAL else math.atan2(-R[0, 1], R[1, 1])
    cosine, minus_sine = R[1, 1:] * math.cos(yaw) - R[0, 1:] * math.sin(yaw)
    roll = math.atan2(-minus_sine, cosine) if flat >= GIMBAL else 0.0
    return T[:3, 3].tolist(), [roll, math.atan2(-R[2, 0], flat), yaw]


def to_xyz_angles(R: Array) -> tuple[float, float, float]:
    """Angles alpha, beta, gamma of a rotation (3, 3) = Rx(alpha) Ry(beta) Rz(gamma), as our placements have them."""
    flat = math.hypot(R[0, 0], R[0, 1])
    alpha = math.atan2(-R[1, 2], R[2, 2]) if flat >= GIMBAL else math.atan2(R[2, 1], R[1, 1])
    sine, cosine = R[1, :2] * math.cos(alpha) + R[2, :2] * math.sin(alpha)
    return alpha, math.atan2(R[0, 2], flat), math.atan2(sine, cosine) if flat >= GIMBAL else 0.0


def placement_motion(p: Placement) -> Array:
    """(4, 4), T(x, y, z) Rx(alpha) Ry(beta) Rz(gamma)."""
    about = turn((1, 0, 0), p.alpha) @ turn((0, 1, 0), p.beta) @ turn((0, 0, 1), p.gamma)
    return shift((p.x, p.y, p.z)) @ about


def placement(shift: Array, R: Array) -> Placement:
    """A shift (3,), m, then a rotation (3, 3) as Rx Ry Rz: of a base; of a tool the shift comes after the rotation."""
    x, y, z = shift.tolist()
    return Placement(x, y, z, *to_xyz_angles(R))
