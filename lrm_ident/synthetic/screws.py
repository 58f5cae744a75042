"""Rigid motions as exponentials of twists (Murray, Li, Sastry: A Mathematical Introduction to Robotic Manipulation).

A twist is (angular part, velocity of the point at the world origin); all in world axes, m and rad.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def rotation(turn_rad: ArrayLike) -> Array:
    """Rodrigues: rotation vectors (..., 3) in rad to matrices (..., 3, 3)."""
    turn = np.asarray(turn_rad, dtype=float)
    angle = np.linalg.norm(turn, axis=-1)[..., None, None]
    K = skew(turn)
    # sinc holds at angle zero, where sin(angle) / angle does not; half angles keep 1 - cos exact for small turns
    half = np.sinc(angle / (2.0 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half**2 * (K @ K))


def skew(v: Array) -> Array:
    """Matrices (..., 3, 3) of the cross product v x, for v (..., 3)."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    o = np.zeros_like(x)
    return np.stack([np.stack(row, -1) for row in ([o, -z, y], [z, o, -x], [-y, x, o])], -2)


@dataclass(frozen=True)
class Motion:
    """Rigid motions of points given in world axes: p -> turn p + shift; turn (..., 3, 3), shift (..., 3) in m."""

    turn: Array
    shift: Array

    def __matmul__(self, first: Motion) -> Motion:
        return Motion(self.turn @ first.turn, self.point(first.shift))

    def point(self, p: Array) -> Array:
        """Where the points p (..., 3) in m come to."""
        return self.direction(p) + self.shift

    def direction(self, v: Array) -> Array:
        """How the directions v (..., 3) turn."""
        return np.asarray((self.turn @ v[..., None])[..., 0])


def line_twist(axis: Array, point: Array) -> Array:
    """Twist (6,) of a rotation about the line through point (3,) in m along the unit vector axis (3,)."""
    return np.concatenate([axis, np.cross(point, axis)])


def exponential(twist: Array, angle_rad: Array) -> Motion:
    """Motions of a twist (6,) with a unit angular part over the angles (...,) in rad."""
    axis, velocity = twist[:3], twist[3:]
    angle = np.asarray(angle_rad)[..., None]
    turn = rotation(axis * angle)
    across = np.cross(axis, velocity)
    along = axis * (axis @ velocity)
    return Motion(turn, across - turn @ across + along * angle)


def displacement(centre: Array, turn_rad: Array, shift_m: Array) -> Motion:
    """Rotate by the vectors turn_rad (..., 3) about the point centre (3,), then shift by shift_m (..., 3)."""
    turn = rotation(turn_rad)
    return Motion(turn, centre - turn @ centre + shift_m)


@dataclass(frozen=True)
class Frame:
    """A frame at zero configuration: axes (3, 3) with its unit vectors as columns, origin (3,) in m."""

    axes: Array
    origin: Array

    def turned(self, axis: int, angle_rad: float) -> Frame:
        """Turned about its own axis 0, 1 or 2."""
        return Frame(rotation(self.axes[:, axis] * angle_rad) @ self.axes, self.origin)

    def moved(self, axis: int, distance_m: float) -> Frame:
        """Moved along its own axis 0, 1 or 2."""
        return Frame(self.axes, self.origin + self.axes[:, axis] * distance_m)

    def displaced(self, twist: ArrayLike) -> Frame:
        """Turned about its own origin and shifted: (6,) rotation vector in rad and shift in m, in world axes."""
        error = np.asarray(twist, dtype=float)
        return Frame(rotation(error[:3]) @ self.axes, self.origin + error[3:])

    def place(self, local: ArrayLike) -> Array:
        """World coordinates (3,) in m of a point given in this frame."""
        return np.asarray(self.origin + self.axes @ np.asarray(local, dtype=float))


WORLD = Frame(np.eye(3), np.zeros(3))
