"""Goals of inverse kinematics: a position, alone, with an orientation, or with an approach direction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from lrm_math.arrays import Array, Vector3
from lrm_math.errors import LrmError
from lrm_math.kinematics.chain import rotation_about
from lrm_math.kinematics.motion import Motion

Rotation: TypeAlias = tuple[Vector3, Vector3, Vector3]

ROUNDED, ORTHONORMAL = 1e-4, 1e-9
"""Largest deviation of RᵀR from the identity: in input to `pose`, which orthonormalises, and in a goal."""
CHAR_LENGTH = 0.1
"""m: weight of a rotation by 1 rad against a distance (characteristic length), as in the kernel."""
UNIT = 1e-6
"""Largest deviation of an approach direction's length from 1."""


@dataclass(frozen=True, slots=True)
class Goal:
    """Target of the tool frame (TCP), in the frame that the arm's base placement is given in.

    Attributes:
        position: m.
        rotation: rows of the tool frame's rotation matrix, or None.
        approach: unit vector that the tool's z axis shall point along, or None. At most one of the two is given.

    Raises `LrmError`: a number that is not finite, a matrix that is no rotation, an approach that is no unit vector.
    """

    position: Vector3
    rotation: Rotation | None = None
    approach: Vector3 | None = None

    def __post_init__(self) -> None:
        _check_numbers("position", self.position)
        if self.rotation is not None and self.approach is not None:
            raise LrmError("goal: rotation and approach are both given; give one of them, or none for the position")
        if self.rotation is not None:
            _check_rotation(self.rotation)
        if self.approach is not None:
            _check_numbers("approach", self.approach)
            length = math.hypot(*self.approach)
            if abs(length - 1.0) > UNIT:
                raise LrmError(f"goal: approach has length {length:.6g}; should be a unit vector (see point_along)")

    @property
    def constraints(self) -> int:
        """Number of the tool's six degrees of freedom that the goal fixes: 6, 5 or 3."""
        if self.rotation is not None:
            return 6
        return 3 if self.approach is None else 5

    def angle_from(self, rotation: Rotation) -> float:
        """Angle (rad) from a tool frame's orientation to this one, or to the approach; 0 for a position alone."""
        (ax, bx, cx), (ay, by, cy), (az, bz, cz) = rotation
        if self.rotation is not None:
            (px, qx, rx), (py, qy, ry), (pz, qz, rz) = self.rotation
            trace = ax * px + ay * py + az * pz + bx * qx + by * qy + bz * qz + cx * rx + cy * ry + cz * rz
            x = ay * pz - az * py + by * qz - bz * qy + cy * rz - cz * ry
            y = az * px - ax * pz + bz * qx - bx * qz + cz * rx - cx * rz
            z = ax * py - ay * px + bx * qy - by * qx + cx * ry - cy * rx
            return math.atan2(0.5 * math.hypot(x, y, z), 0.5 * (trace - 1.0))
        if self.approach is None:
            return 0.0
        x, y, z = self.approach
        sine = math.hypot(cy * z - cz * y, cz * x - cx * z, cx * y - cy * x)
        return math.atan2(sine, cx * x + cy * y + cz * z)

    def same_kind_at(self, tcp: Array) -> Goal:
        """A goal of the same kind that a tool frame (4, 4) takes."""
        x, y, z = tcp[:3, 3].tolist()
        if self.rotation is not None:
            return Goal((x, y, z), rotation_rows(tcp[:3, :3]))
        return Goal((x, y, z), None, None if self.approach is None else _triple("approach", tcp[:3, 2]))

    def __str__(self) -> str:
        x, y, z = (1e3 * v for v in self.position)
        free = {6: "nothing", 5: "the turn about the approach direction", 3: "the orientation"}[self.constraints]
        return f"TCP at ({x:.1f}, {y:.1f}, {z:.1f}) mm, {free} is free"


Friction: TypeAlias = tuple[tuple[float, ...], ...]
"""(n, K), states of the elements of friction of each joint; empty: all turned over, as after a long move."""


@dataclass(frozen=True, slots=True)
class IkQuery:
    """The goal, the payload (kg), the present joint angles (rad) and the moves that led to them, where known."""

    goal: Goal
    payload: float = 0.0
    near: tuple[float, ...] | None = None
    motion: Motion | None = None

    def friction(self, q: Array, side: Array) -> Friction:
        """(n, K), states of friction after the move to a command q (n,), rad, that counts as one towards `side` (n,);
        empty, as after a long move, where the moves before are not known."""
        return () if self.motion is None else tuple(map(tuple, self.motion.turned(q, side).tolist()))


def pose(position: ArrayLike, rotation: ArrayLike) -> Goal:
    """A full pose: position (3,) in m and rotation matrix (3, 3), whose numbers may be rounded. Raises `LrmError`."""
    matrix = _numbers("rotation", rotation, (3, 3))
    off = float(np.abs(matrix.T @ matrix - np.eye(3)).max())
    if off > ROUNDED:
        raise _no_rotation(off, ROUNDED)
    if off > ORTHONORMAL / 1e3:
        left, _, right = np.linalg.svd(matrix)
        matrix = left @ right
    return Goal(_triple("position", position), rotation_rows(matrix))


def rotation_rows(matrix: Array) -> Rotation:
    """Rotation matrix (3, 3) as rows of floats."""
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    return (a, b, c), (d, e, f), (g, h, i)


def pose_rpy(position: ArrayLike, roll: float, pitch: float, yaw: float) -> Goal:
    """A full pose, orientation as Rz(yaw) Ry(pitch) Rx(roll): rad, about the fixed x, then y, then z axis.

    Raises `LrmError`.
    """
    for name, angle in (("roll", roll), ("pitch", pitch), ("yaw", yaw)):
        if not math.isfinite(angle):
            raise LrmError(f"goal: {name} = {angle}; should be a finite angle in rad")
    matrix = rotation_about(2, yaw) @ rotation_about(1, pitch) @ rotation_about(0, roll)
    return Goal(_triple("position", position), rotation_rows(matrix))


def point(position: ArrayLike) -> Goal:
    """A position (3,) in m, any orientation. Raises `LrmError`."""
    return Goal(_triple("position", position))


def point_along(position: ArrayLike, approach: ArrayLike) -> Goal:
    """A position (3,) in m and the direction (3,), of any length but zero, that the tool's z axis shall point along.

    Raises `LrmError`.
    """
    x, y, z = _triple("approach", approach)
    length = math.hypot(x, y, z)
    if length < 1e-12:
        raise LrmError("goal: approach is the zero vector; should be a direction")
    return Goal(_triple("position", position), None, (x / length, y / length, z / length))


def _triple(name: str, value: ArrayLike) -> Vector3:
    x, y, z = _numbers(name, value, (3,)).tolist()
    return x, y, z


def _numbers(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise LrmError(f"goal: {name} = {value!r}; should be numbers of shape {shape}") from None
    if array.shape != shape:
        raise LrmError(f"goal: {name} has shape {array.shape}; should be {shape}")
    if not np.isfinite(array).all():
        raise LrmError(f"goal: {name} = {array.tolist()}; should be finite numbers")
    return array


def _check_numbers(name: str, value: Sequence[float]) -> None:
    if len(value) != 3 or not all(map(math.isfinite, value)):
        raise LrmError(f"goal: {name} = {value}; should be three finite numbers")


def _check_rotation(rotation: Rotation) -> None:
    for row in rotation:
        _check_numbers("a row of rotation", row)
    a, b, c = rotation
    off = max(*(abs(_dot(row, row) - 1.0) for row in rotation), *(abs(_dot(u, v)) for u, v in ((a, b), (b, c), (c, a))))
    if off > ORTHONORMAL:
        raise _no_rotation(off, ORTHONORMAL)
    cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    if _dot(cross, c) < 0.0:
        raise LrmError("goal: rotation has determinant -1: a mirror image; should be a right-handed rotation matrix")


def _dot(u: Vector3, v: Vector3) -> float:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _no_rotation(off: float, allowed: float) -> LrmError:
    return LrmError(
        f"goal: rotation is off orthonormal by {off:.3g} (RᵀR against the identity); should be at most {allowed:g}"
    )
