"""The arm as lines in space: its joint axes at zero angles, and the tool. All that a closed form needs to know."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import walk

PARALLEL = 1e-12
"""Sine of the angle below which two axes are parallel but for round-off."""
TOUCHING = 1e-12
"""m: distance below which two axes meet but for round-off."""


@dataclass(frozen=True, eq=False)
class Lines:
    """Joint axes and tool frame at zero joint angles, so that T(q) = exp(ξ1 q1) … exp(ξn qn) T(0).

    `axis` (n, 3), unit vectors; `point` (n, 3), m, on the axes; `rotation` (3, 3) and `position` (3,), m, of the tool.
    """

    axis: Array
    point: Array
    rotation: Array
    position: Array

    def reversed(self) -> Lines:
        """The same arm held by its tool: joint n first, T⁻¹ as the goal, seen from the tool frame."""
        R = self.rotation
        return Lines(
            axis=(-self.axis @ R)[::-1],
            point=((self.point - self.position) @ R)[::-1],
            rotation=R.T,
            position=-R.T @ self.position,
        )

    def meeting_point(self, first: int) -> Array | None:
        """Where the axes first, first + 1, first + 2 (from 0) meet (3,), m; None if they do not."""
        h, o = self.axis[first : first + 3], self.point[first : first + 3]
        across = np.eye(3) - h[:, :, None] * h[:, None, :]
        together = across.sum(axis=0)
        if np.linalg.eigvalsh(together)[0] < PARALLEL:
            return None
        meet = np.linalg.solve(together, np.einsum("kij,kj->i", across, o))
        apart = np.linalg.norm(np.einsum("kij,kj->ki", across, meet - o), axis=1)
        return meet if apart.max() < TOUCHING else None


@dataclass(frozen=True, eq=False)
class Link:
    """How one axis stands to the next: Denavit and Hartenberg's (1955) common normal.

    `normal` (3,), unit vector x along it; `a` (m) from foot to foot along x; `sin`, `cos` of the angle from axis to
    axis about x; `foot`, `next_foot` (3,), m: where it meets either axis. `a` and `sin` may be negative.
    """

    normal: Array
    a: float
    sin: float
    cos: float
    foot: Array
    next_foot: Array

    def turned(self) -> Link:
        """The same with its normal the other way."""
        return replace(self, normal=-self.normal, a=-self.a, sin=-self.sin)


def link(lines: Lines, i: int) -> Link:
    """The link between the axes i and i + 1 (from 0)."""
    (h, g), (o, p) = lines.axis[i : i + 2], lines.point[i : i + 2]
    cross, cos = np.cross(h, g), float(h @ g)
    sin = float(np.linalg.norm(cross))
    if sin < PARALLEL:
        way = (p - o) - ((p - o) @ h) * h
        a = float(np.linalg.norm(way))
        normal = way / a if a >= TOUCHING else _perpendicular(h)
        return Link(normal, a if a >= TOUCHING else 0.0, 0.0, float(np.sign(cos)), o, p - ((p - o) @ h) * h)
    normal = cross / sin
    s, t = np.linalg.solve(np.array([[1.0, -cos], [cos, -1.0]]), np.array([h @ (p - o), g @ (p - o)]))
    foot, next_foot = o + s * h, p + t * g
    a = float((next_foot - foot) @ normal)
    return Link(normal, a if abs(a) >= TOUCHING else 0.0, sin, cos if abs(cos) >= PARALLEL else 0.0, foot, next_foot)


def links_of(lines: Lines) -> list[Link]:
    """All links, their normals turned so that no joint has an offset beyond a right angle between its two."""
    links = [link(lines, i) for i in range(len(lines.axis) - 1)]
    for i in range(len(links) - 2, -1, -1):
        if links[i].normal @ links[i + 1].normal < 0.0:
            links[i] = links[i].turned()
    return links


def angle_about(axis: Array, start: Array, end: Array) -> float:
    """Angle that turns one perpendicular of an axis into another (rad)."""
    return float(np.arctan2(axis @ np.cross(start, end), start @ end))


def lines_of(arm: Arm) -> Lines:
    """The axes and the tool of an arm, in the frame that goals are given in."""
    chain = chain_of(arm)
    stretched = walk(chain, chain.values([0.0] * chain.dof), 1)
    slots = list(chain.joint_slots)
    return Lines(
        axis=stretched.axis[slots, :, 0],
        point=stretched.origin[slots, :, 0],
        rotation=stretched.frames[-1, :3, :, 0].T,
        position=stretched.tcp[:, 0],
    )


def _perpendicular(h: Array) -> Array:
    other = np.eye(3)[np.argmin(np.abs(h))]
    across = np.cross(h, other)
    return np.asarray(across / np.linalg.norm(across))
