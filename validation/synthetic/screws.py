"""Rigid motions as exponentials of twists (Murray, Li, Sastry: A Mathematical Introduction to Robotic Manipulation).

A twist is (angular part, velocity of the point at the world origin); all in world axes, m and rad.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def rotation_matrix(turn_rad: ArrayLike) -> Array:
    """Rodrigues' formula: rotation vectors (..., 3) in rad to matrices (..., 3, 3)."""
    vector = np.asarray(turn_rad, dtype=float)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    K = skew(vector)
    # sinc holds at angle zero, where sin(angle) / angle does not; half angles keep 1 - cos exact for small turns
    half = np.sinc(angle / (2.0 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half**2 * (K @ K))


def skew(v: Array) -> Array:
    """Matrices (..., 3, 3) of the cross product v x, for v (..., 3)."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    o = np.zeros_like(x)
    return np.stack([np.stack(row, -1) for row in ([o, -z, y], [z, o, -x], [-y, x, o])], -2)


@dataclass(frozen=True)
class RigidMotion:
    """Rigid motions g = (R, t) in world axes: p -> R p + t; rotation R (..., 3, 3), translation t (..., 3) in m."""

    rotation: Array
    translation: Array

    def __matmul__(self, first: RigidMotion) -> RigidMotion:
        return RigidMotion(self.rotation @ first.rotation, self.point(first.translation))

    def point(self, p: Array) -> Array:
        """The points p (..., 3) in m after the motion."""
        return self.vector(p) + self.translation

    def vector(self, v: Array) -> Array:
        """The free vectors v (..., 3) after the motion."""
        return np.asarray((self.rotation @ v[..., None])[..., 0])


def revolute_twist(axis: Array, point: Array) -> Array:
    """Zero-pitch twist (6,): rotation about the line through point (3,) in m along the unit vector axis (3,)."""
    return np.concatenate([axis, np.cross(point, axis)])


def exponential(twist: Array, angle_rad: Array) -> RigidMotion:
    """Exponential map of a twist (6,) with a unit angular part, for the angles (...,) in rad (Murray, Eq 2.36)."""
    axis, velocity = twist[:3], twist[3:]
    angle = np.asarray(angle_rad)[..., None]
    R = rotation_matrix(axis * angle)
    across = np.cross(axis, velocity)
    along = axis * (axis @ velocity)
    return RigidMotion(R, across - R @ across + along * angle)


def displacement(centre: Array, turn_rad: Array, shift_m: Array) -> RigidMotion:
    """Rotation by the vectors turn_rad (..., 3) about the point centre (3,), then translation by shift_m (..., 3)."""
    R = rotation_matrix(turn_rad)
    return RigidMotion(R, centre - R @ centre + shift_m)


@dataclass(frozen=True)
class CoordinateFrame:
    """A frame at zero configuration: axes (3, 3) with its unit vectors as columns, origin (3,) in m."""

    axes: Array
    origin: Array

    def rotated(self, axis: int, angle_rad: float) -> CoordinateFrame:
        """Rotated about its own axis 0, 1 or 2."""
        return CoordinateFrame(rotation_matrix(self.axes[:, axis] * angle_rad) @ self.axes, self.origin)

    def translated(self, axis: int, distance_m: float) -> CoordinateFrame:
        """Translated along its own axis 0, 1 or 2."""
        return CoordinateFrame(self.axes, self.origin + self.axes[:, axis] * distance_m)

    def displaced(self, twist: ArrayLike) -> CoordinateFrame:
        """Rotated about its own origin and translated: (6,) rotation vector in rad and shift in m, in world axes."""
        error = np.asarray(twist, dtype=float)
        return CoordinateFrame(rotation_matrix(error[:3]) @ self.axes, self.origin + error[3:])

    def to_world(self, local: ArrayLike) -> Array:
        """World coordinates (3,) in m of a point given in this frame."""
        return np.asarray(self.origin + self.axes @ np.asarray(local, dtype=float))


WORLD = CoordinateFrame(np.eye(3), np.zeros(3))
