"""Screw axes of the joints at zero angles, and the common normals between them (Denavit & Hartenberg 1955)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry

PARALLEL = 1e-12
"""Sine of the angle below which two axes are parallel but for round-off."""
TOUCHING = 1e-12
"""m: distance below which two axes meet but for round-off."""


@dataclass(frozen=True, eq=False)
class ScrewAxes:
    """Joint axes and tool frame at zero joint angles: T(q) = exp(ξ1 q1) … exp(ξn qn) T(0) (product of exponentials).

    `axis` (n, 3), unit vectors; `point` (n, 3), m, on the axes; `rotation` (3, 3) and `position` (3,), m, of the tool.
    """

    axis: Array
    point: Array
    rotation: Array
    position: Array

    def reversed(self) -> ScrewAxes:
        """The same arm with base and tool exchanged: joint n first, T⁻¹ as the goal."""
        R = self.rotation
        return ScrewAxes((-self.axis @ R)[::-1], ((self.point - self.position) @ R)[::-1], R.T, -R.T @ self.position)

    def meeting_point(self, first: int) -> Array | None:
        """(3,), m, where the axes first, first + 1, first + 2 (from 0) intersect; None if they do not."""
        h, o = self.axis[first : first + 3], self.point[first : first + 3]
        across = np.eye(3) - h[:, :, None] * h[:, None, :]
        together = across.sum(axis=0)
        if np.linalg.eigvalsh(together)[0] < PARALLEL:
            return None
        meet = np.linalg.solve(together, np.einsum("kij,kj->i", across, o))
        apart = np.linalg.norm(np.einsum("kij,kj->ki", across, meet - o), axis=1)
        return meet if apart.max() < TOUCHING else None


@dataclass(frozen=True, eq=False)
class CommonNormal:
    """Common normal of consecutive axes.

    `normal` (3,), unit vector x along it; `a` (m) from foot to foot along x; `sin`, `cos` of the angle between the axes
    about x; `foot`, `next_foot` (3,), m: where it meets either axis. `a` and `sin` may be negative.
    """

    normal: Array
    a: float
    sin: float
    cos: float
    foot: Array
    next_foot: Array

    def flipped(self) -> CommonNormal:
        """The same normal, direction reversed."""
        return replace(self, normal=-self.normal, a=-self.a, sin=-self.sin)


def common_normal(axes: ScrewAxes, i: int) -> CommonNormal:
    """The common normal of the axes i and i + 1 (from 0)."""
    (h, g), (o, p) = axes.axis[i : i + 2], axes.point[i : i + 2]
    cross, cos = np.cross(h, g), float(h @ g)
    sin = float(np.linalg.norm(cross))
    if sin < PARALLEL:
        offset = (p - o) - ((p - o) @ h) * h
        a = float(np.linalg.norm(offset))
        normal = offset / a if a >= TOUCHING else _perpendicular(h)
        return CommonNormal(normal, a if a >= TOUCHING else 0.0, 0.0, float(np.sign(cos)), o, p - ((p - o) @ h) * h)
    normal = cross / sin
    s, t = np.linalg.solve(np.array([[1.0, -cos], [cos, -1.0]]), np.array([h @ (p - o), g @ (p - o)]))
    foot, next_foot = o + s * h, p + t * g
    a = float((next_foot - foot) @ normal)
    return CommonNormal(
        normal, a if abs(a) >= TOUCHING else 0.0, sin, cos if abs(cos) >= PARALLEL else 0.0, foot, next_foot
    )


def common_normals(axes: ScrewAxes) -> list[CommonNormal]:
    """All common normals, directed so that no joint offset exceeds a right angle."""
    normals = [common_normal(axes, i) for i in range(len(axes.axis) - 1)]
    for i in range(len(normals) - 2, -1, -1):
        if normals[i].normal @ normals[i + 1].normal < 0.0:
            normals[i] = normals[i].flipped()
    return normals


def angle_about(axis: Array, start: Array, end: Array) -> float:
    """Angle that turns one perpendicular of an axis into another (rad)."""
    return float(np.arctan2(axis @ np.cross(start, end), start @ end))


def screw_axes_of(arm: Arm) -> ScrewAxes:
    """Axes and tool of an arm, in the frame that goals are given in."""
    chain = chain_of(arm)
    stretched = chain_geometry(chain, chain.values([0.0] * chain.dof), 1)
    slots = list(chain.joint_slots)
    return ScrewAxes(
        axis=stretched.axis[slots, :, 0],
        point=stretched.origin[slots, :, 0],
        rotation=stretched.tool[:3, :, 0].T,
        position=stretched.tcp[:, 0],
    )


def _perpendicular(h: Array) -> Array:
    other = np.eye(3)[np.argmin(np.abs(h))]
    across = np.cross(h, other)
    return np.asarray(across / np.linalg.norm(across))
