"""A calibrated arm at one candidate, in scalar Python: frames, screws and gravity's loads at full speed.

`linkage` has the same arm for many candidates as array expressions over slots, translations included, which are left
out here. For one candidate Python's floats are several times faster.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import TypeAlias

import numpy as np

from lrm_math.chain import Array
from lrm_math.ik.goal import Triple
from lrm_math.ik.linkage import Burden, Linkage

Frame: TypeAlias = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""Columns x, y, z and origin, one after the other (1; m)."""
START: Frame = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Stand:
    """Where one candidate stands, in the base's frame.

    `tcp`: the tool's frame. `axis`, `origin`: of each of the V moving slots (unit vectors; m).
    `beyond`: first mass moment of each of the B bodies and all further out (kg m), and at last zero.
    """

    tcp: Frame
    axis: list[Triple]
    origin: list[Triple]
    beyond: list[Triple]

    def matrix(self) -> Array:
        """(4, 4), the tool's frame."""
        out = np.eye(4)
        out[:3] = np.array(self.tcp).reshape(4, 3).T
        return out


@dataclass(frozen=True)
class Cargo:
    """What the arm carries: of each body mass times centre and mass, in the frame of its moving slot, by the number of
    slots that it stands behind (kg m, kg); and the mass of each body and all further out (kg)."""

    bodies: tuple[tuple[tuple[float, float, float, float], ...], ...]
    beyond: tuple[float, ...]


@dataclass(frozen=True)
class OneLinkage:
    """The rotating slots of a linkage, each about the z axis of a frame of its own, and the rigid pieces between.

    Attributes:
        pieces: the way to each slot's frame, and last to the tool's; None where only the axes change their names, z
            to y, y to x, x to z.
        axes: number from 0 of the axis that each slot turns about as the linkage has it.
        stands: how many slots each body stands behind.
        counted: the first body that each slot's load counts. `gravity`: m/s².
    """

    pieces: tuple[Frame | None, ...]
    axes: tuple[int, ...]
    stands: tuple[int, ...]
    counted: tuple[int, ...]
    gravity: Triple

    @classmethod
    def of(cls, linkage: Linkage) -> OneLinkage | None:
        """That of a linkage; None if some of its slots are translations."""
        if len(linkage.slides):
            return None
        axes = tuple(linkage.axes.tolist())
        fixed, by_c, _ = linkage.pieces[:, :, 0]
        welds = [*(fixed + by_c), linkage.end]
        turns = [np.eye(4), *(_z_to(axis) for axis in axes), np.eye(4)]
        pieces = tuple(_piece(turns[v].T @ weld @ turns[v + 1]) for v, weld in enumerate(welds))
        cross = linkage.gravity_cross
        gravity = (float(cross[2, 1]), float(cross[0, 2]), float(cross[1, 0]))
        return cls(pieces, axes, tuple(linkage.stands.tolist()), tuple(linkage.counted.tolist()), gravity)

    def cargo(self, burden: Burden) -> Cargo:
        """The same burden, seen from these frames."""
        bodies: list[list[tuple[float, float, float, float]]] = [[] for _ in self.pieces]
        for stands, row in zip(self.stands, burden.moment[:, 0, :, 0].tolist(), strict=True):
            x, y, z, mass = row
            axis = self.axes[stands - 1] if stands else 2
            bodies[stands].append(((x, y, z), (y, z, x), (z, x, y))[(axis + 1) % 3] + (mass,))
        return Cargo(tuple(map(tuple, bodies)), tuple(burden.beyond.tolist()))

    def stand(self, amounts: Sequence[float], cargo: Cargo) -> Stand:
        """Frames, screws and mass moments at the amounts (V,) of the slots (rad)."""
        ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz = START
        axis: list[Triple] = []
        origin: list[Triple] = []
        moments = [mass_and_centre[:3] for mass_and_centre in cargo.bodies[0]]
        for piece, amount, bodies in zip(self.pieces, amounts, cargo.bodies[1:], strict=False):
            if piece is None:
                ax, ay, az, bx, by, bz, cx, cy, cz = bx, by, bz, cx, cy, cz, ax, ay, az
            else:
                x0, x1, x2, y0, y1, y2, z0, z1, z2, o0, o1, o2 = piece
                px += ax * o0 + bx * o1 + cx * o2
                py += ay * o0 + by * o1 + cy * o2
                pz += az * o0 + bz * o1 + cz * o2
                ax, bx, cx = ax * x0 + bx * x1 + cx * x2, ax * y0 + bx * y1 + cx * y2, ax * z0 + bx * z1 + cx * z2
                ay, by, cy = ay * x0 + by * x1 + cy * x2, ay * y0 + by * y1 + cy * y2, ay * z0 + by * z1 + cy * z2
                az, bz, cz = az * x0 + bz * x1 + cz * x2, az * y0 + bz * y1 + cz * y2, az * z0 + bz * z1 + cz * z2
            c, s = cos(amount), sin(amount)
            ax, bx = c * ax + s * bx, c * bx - s * ax
            ay, by = c * ay + s * by, c * by - s * ay
            az, bz = c * az + s * bz, c * bz - s * az
            axis.append((cx, cy, cz))
            origin.append((px, py, pz))
            for x, y, z, m in bodies:
                moments.append(
                    (
                        ax * x + bx * y + cx * z + px * m,
                        ay * x + by * y + cy * z + py * m,
                        az * x + bz * y + cz * z + pz * m,
                    )
                )
        frame = (ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz)
        return Stand(_then(frame, self.pieces[-1]), axis, origin, _summed(moments))

    def levers(self, stand: Stand) -> list[Triple]:
        """Gravity x axis of every slot (m/s²)."""
        gx, gy, gz = self.gravity
        return [(gy * z - gz * y, gz * x - gx * z, gx * y - gy * x) for x, y, z in stand.axis]

    def loads(self, stand: Stand, levers: Sequence[Triple], cargo: Cargo) -> list[float]:
        """Gravity's load on every slot (N·m)."""
        out = []
        for (hx, hy, hz), (ox, oy, oz), body in zip(levers, stand.origin, self.counted, strict=True):
            (x, y, z), m = stand.beyond[body], cargo.beyond[body]
            out.append(hx * (x - m * ox) + hy * (y - m * oy) + hz * (z - m * oz))
        return out


def swept(stand: Stand, cargo: Cargo, moved: Sequence[int]) -> list[Triple]:
    """What a turn of each slot by 1 rad does to the first mass moment of the bodies from `moved` outwards (kg m)."""
    out = []
    for (ax, ay, az), (ox, oy, oz), body in zip(stand.axis, stand.origin, moved, strict=True):
        (x, y, z), m = stand.beyond[body], cargo.beyond[body]
        x, y, z = x - m * ox, y - m * oy, z - m * oz
        out.append((ay * z - az * y, az * x - ax * z, ax * y - ay * x))
    return out


def screws(stand: Stand, lever: float) -> list[tuple[float, ...]]:
    """The TCP's velocity (m/rad) and `lever` times the tool's rate of turn, in the base's frame, slot by slot."""
    px, py, pz = stand.tcp[9:]
    out = []
    for (ax, ay, az), (ox, oy, oz) in zip(stand.axis, stand.origin, strict=True):
        x, y, z = px - ox, py - oy, pz - oz
        out.append((ay * z - az * y, az * x - ax * z, ax * y - ay * x, lever * ax, lever * ay, lever * az))
    return out


def _summed(moments: list[Triple]) -> list[Triple]:
    """Sums of each and all that come after it, and at last zero."""
    x = y = z = 0.0
    out = [(x, y, z)]
    for dx, dy, dz in reversed(moments):
        x, y, z = x + dx, y + dy, z + dz
        out.append((x, y, z))
    out.reverse()
    return out


def _then(frame: Frame, piece: Frame | None) -> Frame:
    """The frame at the end of a rigid piece that starts at a frame."""
    ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz = frame
    if piece is None:
        return bx, by, bz, cx, cy, cz, ax, ay, az, px, py, pz
    x0, x1, x2, y0, y1, y2, z0, z1, z2, o0, o1, o2 = piece
    return (
        *(ax * x0 + bx * x1 + cx * x2, ay * x0 + by * x1 + cy * x2, az * x0 + bz * x1 + cz * x2),
        *(ax * y0 + bx * y1 + cx * y2, ay * y0 + by * y1 + cy * y2, az * y0 + bz * y1 + cz * y2),
        *(ax * z0 + bx * z1 + cx * z2, ay * z0 + by * z1 + cy * z2, az * z0 + bz * z1 + cz * z2),
        *(px + ax * o0 + bx * o1 + cx * o2, py + ay * o0 + by * o1 + cy * o2, pz + az * o0 + bz * o1 + cz * o2),
    )


def _z_to(axis: int) -> Array:
    """(4, 4), a frame whose z is the given axis: its x and y the next two, in a circle."""
    out = np.zeros((4, 4))
    out[[(axis + 1) % 3, (axis + 2) % 3, axis, 3], [0, 1, 2, 3]] = 1.0
    return out


NEXT_AXIS = _z_to(0)
"""(4, 4), what turns the frame of a slot about x into that of one about y at the same place, or y into z, z into x."""


def _piece(weld: Array) -> Frame | None:
    """The twelve numbers of a rigid piece, or None for a mere change of names."""
    if np.array_equal(weld, NEXT_AXIS):
        return None
    (x0, y0, z0, o0), (x1, y1, z1, o1), (x2, y2, z2, o2), _ = weld.tolist()
    return x0, x1, x2, y0, y1, y2, z0, z1, z2, o0, o1, o2
