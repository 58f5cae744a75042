"""Homogeneous transforms (4, 4) from the numbers that robot descriptions use; m and rad."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lrm_math.arm.arm import Placement
from lrm_math.arrays import Array

GIMBAL = 1e-12
"""Cosine of the pitch below which roll and yaw are one angle."""


def turn(axis: Sequence[float], angle: float) -> Array:
    """(4, 4), rotation about a unit axis (Rodrigues' formula), rad."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    out = np.eye(4)
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
    out = np.eye(4)
    out[:3, :3] = T[:3, :3].T
    out[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return out


def from_xyz_rpy(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    """(4, 4), URDF's `<origin>`: translation, then Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = rpy
    return shift(xyz) @ turn((0, 0, 1), yaw) @ turn((0, 1, 0), pitch) @ turn((1, 0, 0), roll)


def to_xyz_rpy(T: Array) -> tuple[list[float], list[float]]:
    """The inverse of `from_xyz_rpy`."""
    R = T[:3, :3]
    flat = math.hypot(R[0, 0], R[1, 0])
    pitch = math.atan2(-R[2, 0], flat)
    if flat < GIMBAL:
        return T[:3, 3].tolist(), [0.0, pitch, math.atan2(-R[0, 1], R[1, 1])]
    return T[:3, 3].tolist(), [math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])]


def to_xyz_angles(R: Array) -> tuple[float, float, float]:
    """Angles alpha, beta, gamma of a rotation (3, 3) = Rx(alpha) Ry(beta) Rz(gamma), as our placements have them."""
    flat = math.hypot(R[0, 0], R[0, 1])
    beta = math.atan2(R[0, 2], flat)
    if flat < GIMBAL:
        return math.atan2(R[2, 1], R[1, 1]), beta, 0.0
    return math.atan2(-R[1, 2], R[2, 2]), beta, math.atan2(-R[0, 1], R[0, 0])


def quaternion(R: Array) -> list[float]:
    """Unit quaternion w, x, y, z of a rotation (3, 3); w is not negative (Shepperd 1978)."""
    sums = np.array([np.trace(R), *np.diag(R)])
    k = int(np.argmax(sums))
    q = np.empty(4)
    if k == 0:
        q[:] = 1.0 + sums[0], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    else:
        i, j, m = k - 1, k % 3, (k + 1) % 3
        q[0] = R[m, j] - R[j, m]
        q[1 + i] = 1.0 + 2.0 * R[i, i] - sums[0]
        q[1 + j], q[1 + m] = R[i, j] + R[j, i], R[i, m] + R[m, i]
    q /= np.linalg.norm(q)
    return (-q if q[0] < 0 else q).tolist()


def base_placement(T: Array) -> Placement:
    """A pose as T(x, y, z) Rx Ry Rz."""
    return _placement(T[:3, 3], T[:3, :3])


def tool_placement(T: Array) -> Placement:
    """A pose as Rx Ry Rz T(x, y, z)."""
    return _placement(T[:3, :3].T @ T[:3, 3], T[:3, :3])


def _placement(shift: Array, R: Array) -> Placement:
    x, y, z = shift.tolist()
    return Placement(x, y, z, *to_xyz_angles(R))
