"""A calibrated arm at one candidate, in scalar Python: frames, screws and gravity's loads at full speed.

`linkage` has the same arm for many candidates as array expressions over slots, translations included, which are left
out here. For one candidate Python's floats are several times faster, in straight lines all the more (see `unrolled`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.goal import Triple
from lrm_math.ik.linkage import Burden, Linkage
from lrm_math.ik.unrolled import function, stand_text, tool_text

Frame: TypeAlias = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""Columns x, y, z and origin, one after the other (1; m)."""
Cargo: TypeAlias = Sequence[tuple[float, float, float, float]]
"""What the arm carries: of each body mass times centre, and mass, in the frame that it stands in (kg m, kg)."""


class Stand(NamedTuple):
    """Where one candidate stands, in the base's frame.

    `tcp`: the tool's frame. `axis`, `origin`: of each of the V moving slots (unit vectors; m). `tau`: gravity's load on
    each (N·m).
    """

    tcp: Frame
    axis: list[Triple]
    origin: list[Triple]
    tau: list[float]


@dataclass(frozen=True)
class OneLinkage:
    """The rotating slots of a linkage and the rigid pieces between them.

    Attributes:
        welds: (4, 4), the way to each slot, and from the last one to the tool's frame.
        axes: number from 0 of the axis that each slot turns about.
        stands: how many slots each body stands behind, ascending.
        counted: the first body that each slot's load counts. `gravity`: m/s².
    """

    welds: tuple[Array, ...]
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
            welds=(*(fixed + by_c), linkage.end),
            axes=tuple(linkage.axes.tolist()),
            stands=tuple(linkage.stands.tolist()),
            counted=tuple(linkage.counted.tolist()),
            gravity=(float(cross[2, 1]), float(cross[0, 2]), float(cross[1, 0])),
        )

    def cargo(self, burden: Burden) -> Cargo:
        """The same burden, body by body."""
        return [(x, y, z, mass) for x, y, z, mass in burden.moment[:, 0, :, 0].tolist()]

    def stand(self, amounts: Sequence[float], cargo: Cargo) -> Stand:
        """Frames, screws and loads at the amounts (V,) of the slots (rad)."""
        return Stand(*self._stand(amounts, cargo))

    def tool(self, amounts: Sequence[float]) -> Frame:
        """The tool's frame at the amounts (V,) of the slots (rad)."""
        return self._tool(amounts)

    @cached_property
    def _stand(self) -> Callable[[Sequence[float], Cargo], tuple[Frame, list[Triple], list[Triple], list[float]]]:
        text = stand_text(self.welds, self.axes, self.stands, self.counted, self.gravity)
        return function(text, "stand")  # type: ignore[no-any-return]

    @cached_property
    def _tool(self) -> Callable[[Sequence[float]], Frame]:
        return function(tool_text(self.welds, self.axes), "tool")  # type: ignore[no-any-return]


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


def frame_of(matrix: Array) -> Frame:
    """The frame of a matrix (4, 4)."""
    ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz = matrix[:3].T.ravel().tolist()
    return ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz


def matrices(frames: Sequence[Frame]) -> Array:
    """(K, 4, 4), the same frames."""
    out = np.zeros((len(frames), 4, 4))
    out[:, :3] = np.array(frames).reshape(-1, 4, 3).transpose(0, 2, 1)
    out[:, 3, 3] = 1.0
    return out
