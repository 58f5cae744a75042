"""Kinematics and gravity loads of one state of a linkage, in scalar Python.

Scalar counterpart of `linkage`, without translating slots. For one state Python's floats are several times faster
than arrays, and straight-line code (see `unrolled`) faster still.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from lrm_math.arrays import Array, Vector3
from lrm_math.ik.linkage import Linkage, MassMoments
from lrm_math.ik.unrolled import compile_function, state_source, tool_source

ScalarFrame: TypeAlias = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""Columns x, y, z and origin of a frame, one after the other (1; m)."""
ScalarMassMoments: TypeAlias = Sequence[tuple[float, float, float, float]]
"""Per body: first mass moment (kg m, three numbers) and mass (kg), in the frame of its moving slot."""


class ScalarLinkageState(NamedTuple):
    """Forward kinematics and gravity loads of one state, in the base frame.

    `tcp`: tool frame. `axis`, `origin`: of the V moving slots (unit vectors; m). `tau`: gravity loads on them (N·m).
    """

    tcp: ScalarFrame
    axis: list[Vector3]
    origin: list[Vector3]
    tau: list[float]


@dataclass(frozen=True)
class ScalarLinkage:
    """The rotating slots of a linkage and the rigid transforms between them.

    `welds`: (4, 4) each, the transform to each slot, and from the last one to the tool frame. `axes`: index (0 to 2) of
    the axis that each slot turns about. `inboard_slots`: number of moving slots inboard of each body, ascending.
    `counted`: first body that each slot's load counts. `gravity`: m/s².
    """

    welds: tuple[Array, ...]
    axes: tuple[int, ...]
    inboard_slots: tuple[int, ...]
    counted: tuple[int, ...]
    gravity: Vector3

    @classmethod
    def of(cls, linkage: Linkage) -> ScalarLinkage | None:
        """From a linkage; None if some of its slots translate."""
        if len(linkage.slides):
            return None
        fixed, by_c, _ = linkage.pieces[:, :, 0]
        cross = linkage.gravity_cross
        return cls(
            welds=(*(fixed + by_c), linkage.end),
            axes=tuple(linkage.axes.tolist()),
            inboard_slots=tuple(linkage.inboard_slots.tolist()),
            counted=tuple(linkage.counted.tolist()),
            gravity=(float(cross[2, 1]), float(cross[0, 2]), float(cross[1, 0])),
        )

    def scalar_moments(self, mass_moments: MassMoments) -> ScalarMassMoments:
        """Mass moments as a list of bodies."""
        return [(x, y, z, mass) for x, y, z, mass in mass_moments.moment[:, 0, :, 0].tolist()]

    def forward(self, amounts: Sequence[float], bodies: ScalarMassMoments) -> ScalarLinkageState:
        """Forward kinematics and gravity loads at slot amounts (V,), rad."""
        return ScalarLinkageState(*self._state(amounts, bodies))

    def tool_frame(self, amounts: Sequence[float]) -> ScalarFrame:
        """Tool frame at slot amounts (V,), rad."""
        return self._tool_frame(amounts)

    @cached_property
    def _state(self) -> Callable[[Sequence[float], ScalarMassMoments], tuple[Any, ...]]:
        text = state_source(self.welds, self.axes, self.inboard_slots, self.counted, self.gravity)
        return compile_function(text, "state")  # type: ignore[no-any-return]

    @cached_property
    def _tool_frame(self) -> Callable[[Sequence[float]], ScalarFrame]:
        return compile_function(tool_source(self.welds, self.axes), "tool_frame")  # type: ignore[no-any-return]


def jacobian_rows(state: ScalarLinkageState, slots: Iterable[int], length: float) -> Array:
    """(len(slots), 6): transposed Jacobian columns, TCP velocity (m/rad) and `length` times angular velocity."""
    px, py, pz = state.tcp[9:]
    out: list[float] = []
    for v in slots:
        (ax, ay, az), (ox, oy, oz) = state.axis[v], state.origin[v]
        x, y, z = px - ox, py - oy, pz - oz
        out += (ay * z - az * y, az * x - ax * z, ax * y - ay * x, length * ax, length * ay, length * az)
    return np.array(out).reshape(-1, 6)


def twist(state: ScalarLinkageState, turns: Iterable[tuple[int, float]], length: float) -> tuple[float, ...]:
    """(6,): TCP displacement (m), and `length` times rotation, caused by turns of slots (number, rad), linearised."""
    px, py, pz = state.tcp[9:]
    wx = wy = wz = mx = my = mz = 0.0
    for v, turn in turns:
        (ax, ay, az), (ox, oy, oz) = state.axis[v], state.origin[v]
        ax, ay, az = turn * ax, turn * ay, turn * az
        wx, wy, wz = wx + ax, wy + ay, wz + az
        mx, my, mz = mx + ay * oz - az * oy, my + az * ox - ax * oz, mz + ax * oy - ay * ox
    return (
        wy * pz - wz * py - mx,
        wz * px - wx * pz - my,
        wx * py - wy * px - mz,
        length * wx,
        length * wy,
        length * wz,
    )


def frame_of(matrix: Array) -> ScalarFrame:
    """Scalar frame of a homogeneous matrix (4, 4)."""
    ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz = matrix[:3].T.ravel().tolist()
    return ax, ay, az, bx, by, bz, cx, cy, cz, px, py, pz


def matrices(frames: Sequence[ScalarFrame]) -> Array:
    """(K, 4, 4), homogeneous matrices of scalar frames."""
    out = np.zeros((len(frames), 4, 4))
    out[:, :3] = np.array(frames).reshape(-1, 4, 3).transpose(0, 2, 1)
    out[:, 3, 3] = 1.0
    return out
