"""A calibrated arm at one candidate, in scalar Python: frames, screws and gravity's loads at full speed.

`linkage` has the same arm for many candidates as array expressions over slots, translations included, which are left
out here. For one candidate Python's floats are several times faster.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import cos, sin
from typing import TypeAlias

import numpy as np

from lrm_math.chain import Array, X, Z
from lrm_math.ik.goal import Triple
from lrm_math.ik.linkage import Burden, Linkage

Frame: TypeAlias = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""Columns x, y, z and origin, one after the other (1; m)."""
Turn: TypeAlias = tuple[Triple, Triple, Triple]
NO_AXIS = -1
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


@dataclass(frozen=True)
class Cargo:
    """What the arm carries: of each body mass times centre and mass, in the frame of its moving slot, by the number of
    slots that it stands behind (kg m, kg); and the mass of each body and all further out (kg)."""

    bodies: tuple[tuple[tuple[float, float, float, float], ...], ...]
    beyond: tuple[float, ...]


@dataclass(frozen=True)
class Piece:
    """A rigid piece: a `shift` (m), then a turn: a `tilt` about x (cosine and sine) or any other `turn` (columns x, y,
    z); each None where there is none."""

    shift: Triple | None
    tilt: tuple[float, float] | None
    turn: Turn | None

    @classmethod
    def of(cls, weld: Array) -> Piece:
        """From a matrix (4, 4). Denavit and Hartenberg's links only tilt, and most other pieces do not even that."""
        R, way = weld[:3, :3], weld[:3, 3].tolist()
        shift = (way[0], way[1], way[2]) if any(way) else None
        if np.array_equal(R, np.eye(3)):
            return cls(shift, None, None)
        if R[0, 0] == 1.0:
            return cls(shift, (float(R[1, 1]), float(R[2, 1])), None)
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = R.T.tolist()
        return cls(shift, None, ((ax, ay, az), (bx, by, bz), (cx, cy, cz)))


@dataclass(frozen=True)
class OneLinkage:
    """The rotating slots of a linkage and the rigid pieces between them.

    Attributes:
        pieces: shift, tilt and turn (see `Piece`) of the way to each slot, and of the last one to the tool's frame.
        axes: number from 0 of the axis that each slot turns about.
        stands: how many slots each body stands behind.
        counted: the first body that each slot's load counts. `gravity`: m/s².
    """

    pieces: tuple[Piece, ...]
    axes: tuple[int, ...]
    stands: tuple[int, ...]
    counted: tuple[int, ...]
    gravity: Triple

    @classmethod
    def of(cls, linkage: Linkage) -> OneLinkage | None:
        """That of a linkage; None if some of its slots are translations."""
        if len(linkage.slides):
            return None
        fixed, by_c, _ = linkage.pieces[:, :, 0]
        cross = linkage.gravity_cross
        return cls(
            pieces=tuple(Piece.of(weld) for weld in (*(fixed + by_c), linkage.end)),
            axes=tuple(linkage.axes.tolist()),
            stands=tuple(linkage.stands.tolist()),
            counted=tuple(linkage.counted.tolist()),
            gravity=(float(cross[2, 1]), float(cross[0, 2]), float(cross[1, 0])),
        )

    def cargo(self, burden: Burden) -> Cargo:
        """The same burden, sorted by slots."""
        bodies: list[list[tuple[float, float, float, float]]] = [[] for _ in self.pieces]
        for stands, (x, y, z, mass) in zip(self.stands, burden.moment[:, 0, :, 0].tolist(), strict=True):
            bodies[stands].append((x, y, z, mass))
        return Cargo(tuple(map(tuple, bodies)), tuple(burden.beyond.tolist()))

    @cached_property
    def _stages(self) -> list[tuple[Triple | None, tuple[float, float] | None, Turn | None, int]]:
        """Pieces and the axes after them, the tool's frame after the last."""
        axes = (*self.axes, NO_AXIS)
        return [(p.shift, p.tilt, p.turn, axis) for p, axis in zip(self.pieces, axes, strict=True)]

    def stand(self, amounts: Sequence[float], cargo: Cargo) -> Stand:
        """Frames, screws and mass moments at the amounts (V,) of the slots (rad)."""
        ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz = START
        axis: list[Triple] = []
        origin: list[Triple] = []
        moments = [(x, y, z) for x, y, z, _ in cargo.bodies[0]]
        for (shift, tilt, turn, about), amount, bodies in zip(
            self._stages, (*amounts, 0.0), (*cargo.bodies[1:], ()), strict=True
        ):
            if shift is not None:
                x, y, z = shift
                px += ax * x + bx * y + cx * z
                py += ay * x + by * y + cy * z
                pz += az * x + bz * y + cz * z
            if tilt is not None:
                c, s = tilt
                bx, cx = c * bx + s * cx, c * cx - s * bx
                by, cy = c * by + s * cy, c * cy - s * by
                bz, cz = c * bz + s * cz, c * cz - s * bz
            elif turn is not None:
                (x0, x1, x2), (y0, y1, y2), (z0, z1, z2) = turn
                ax, bx, cx = ax * x0 + bx * x1 + cx * x2, ax * y0 + bx * y1 + cx * y2, ax * z0 + bx * z1 + cx * z2
                ay, by, cy = ay * x0 + by * x1 + cy * x2, ay * y0 + by * y1 + cy * y2, ay * z0 + by * z1 + cy * z2
                az, bz, cz = az * x0 + bz * x1 + cz * x2, az * y0 + bz * y1 + cz * y2, az * z0 + bz * z1 + cz * z2
            if about == NO_AXIS:
                break
            c, s = cos(amount), sin(amount)
            if about == Z:
                axis.append((cx, cy, cz))
                ax, bx = c * ax + s * bx, c * bx - s * ax
                ay, by = c * ay + s * by, c * by - s * ay
                az, bz = c * az + s * bz, c * bz - s * az
            elif about == X:
                axis.append((ax, ay, az))
                bx, cx = c * bx + s * cx, c * cx - s * bx
                by, cy = c * by + s * cy, c * cy - s * by
                bz, cz = c * bz + s * cz, c * cz - s * bz
            else:
                axis.append((bx, by, bz))
                cx, ax = c * cx + s * ax, c * ax - s * cx
                cy, ay = c * cy + s * ay, c * ay - s * cy
                cz, az = c * cz + s * az, c * az - s * cz
            origin.append((px, py, pz))
            for x, y, z, m in bodies:
                moments.append(
                    (
                        ax * x + bx * y + cx * z + px * m,
                        ay * x + by * y + cy * z + py * m,
                        az * x + bz * y + cz * z + pz * m,
                    )
                )
        return Stand((ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz), axis, origin, _summed(moments))

    def tool(self, amounts: Sequence[float]) -> Frame:
        """The tool's frame at the amounts (V,) of the slots (rad)."""
        return self.stand(amounts, self._unladen).tcp

    @cached_property
    def _unladen(self) -> Cargo:
        return Cargo(((),) * len(self.pieces), ())

    def loads(self, stand: Stand, cargo: Cargo) -> list[float]:
        """Gravity's load on every slot (N·m)."""
        gx, gy, gz = self.gravity
        out = []
        for (ax, ay, az), (ox, oy, oz), body in zip(stand.axis, stand.origin, self.counted, strict=True):
            (x, y, z), m = stand.beyond[body], cargo.beyond[body]
            x, y, z = x - m * ox, y - m * oy, z - m * oz
            out.append(ax * (y * gz - z * gy) + ay * (z * gx - x * gz) + az * (x * gy - y * gx))
        return out


def screws(stand: Stand, slots: Iterable[int], lever: float) -> Array:
    """(len(slots), 6), the TCP's velocity (m/rad) and `lever` times the tool's rate of turn, in the base's frame."""
    px, py, pz = stand.tcp[9:]
    out: list[float] = []
    for v in slots:
        (ax, ay, az), (ox, oy, oz) = stand.axis[v], stand.origin[v]
        x, y, z = px - ox, py - oy, pz - oz
        out += (ay * z - az * y, az * x - ax * z, ax * y - ay * x, lever * ax, lever * ay, lever * az)
    return np.array(out).reshape(-1, 6)


def twist(stand: Stand, turns: Iterable[tuple[int, float]], lever: float) -> tuple[float, ...]:
    """(6,), the way that turns of slots (number, rad) take the TCP (m), and `lever` times how they turn the tool."""
    px, py, pz = stand.tcp[9:]
    wx = wy = wz = mx = my = mz = 0.0
    for v, turn in turns:
        (ax, ay, az), (ox, oy, oz) = stand.axis[v], stand.origin[v]
        ax, ay, az = turn * ax, turn * ay, turn * az
        wx, wy, wz = wx + ax, wy + ay, wz + az
        mx, my, mz = mx + ay * oz - az * oy, my + az * ox - ax * oz, mz + ax * oy - ay * ox
    return (
        wy * pz - wz * py - mx,
        wz * px - wx * pz - my,
        wx * py - wy * px - mz,
        lever * wx,
        lever * wy,
        lever * wz,
    )


def matrices(frames: Sequence[Frame]) -> Array:
    """(K, 4, 4), the same frames."""
    out = np.zeros((len(frames), 4, 4))
    out[:, :3] = np.array(frames).reshape(-1, 4, 3).transpose(0, 2, 1)
    out[:, 3, 3] = 1.0
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
