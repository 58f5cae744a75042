"""Normal form of an arm whose last (or, held by its tool, first) three axes intersect in one point (Pieper 1968).

Held by the end that leaves the three intersecting axes 4, 5, 6 outermost, the first three joints alone place the wrist
centre S, the last three alone orient the tool. Positions split further with u = Rz(q2) v, the vector from axis 2 to S
in the frame of the first link, and v = V0 + Vc cos q3 + Vs sin q3 in that of the second:

    height above the first axis' normal    sin α1 u_y + cos α1 v_z = C_z              (1)
    distance from the first normal's foot  |v|² + 2 a1 u_x + a1² = |C|²               (2)

Where the axes 1 and 2 intersect (a1 = 0), (2) gives q3; where they are parallel (sin α1 = 0), (1) does; the other one
then gives q2. For skew axes both together are a polynomial of degree four.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from lrm_math.arrays import Array
from lrm_math.kinematics.screw_axes import ScrewAxes, angle_about, common_normals

PieperForm: TypeAlias = Mapping[str, ArrayLike]
"""Constants of the normal form by name; SI, angles counted from the common normals.

frame: columns x, y, z of the goal's (or, backwards, the tool's) frame in the first axis' frame, one after the other.
foot: origin of that frame, in its own axes (m).
centre: wrist centre S in the tool's (backwards: the goal's) frame (m).
tip_x, tip_z: last common normal and last axis there.
a: length of the first common normal (m).
links: (cos, sin) of the angles between consecutive axes, five; the last sine is positive.
offsets: angles of the joints 2 to 5 at q = 0, counted between common normals (rad).
v0, vc, vs: S beyond axis 2, see above (m).
elbow: (constant, amplitude, phase) of the equation that gives q3; amplitude 0 for SKEW.
length: size of the arm (m).
shape: of the first two axes, MEETING, PARALLEL or SKEW.
backwards: the arm is held by its tool: q1 is the last joint's, and the goal is inverted.
"""
MEETING, PARALLEL, SKEW = range(3)
FLAT, ROUND_OFF = 1e-9, 1e-15
"""m, or m²: below it an equation no longer depends on its angle; and a component is zero."""


def pieper_form(axes: ScrewAxes) -> PieperForm | None:
    """The normal form of six axes held by either end; None where no three axes intersect or it degenerates."""
    if len(axes.axis) != 6:
        return None
    return _outward(axes, False) or _outward(axes.reversed(), True)


def _outward(axes: ScrewAxes, backwards: bool) -> PieperForm | None:
    S = axes.meeting_point(3)
    if S is None:
        return None
    normals = common_normals(axes)
    if normals[3].sin == 0.0 or normals[4].sin == 0.0 or (normals[0].sin == 0.0 and normals[0].a == 0.0):
        return None
    h, first = axes.axis, normals[0]
    frame = np.array([first.normal, np.cross(h[0], first.normal), h[0]])
    second = np.array([normals[1].normal, np.cross(h[1], normals[1].normal), h[1]])
    delta = [angle_about(h[i], normals[i - 1].normal, normals[i].normal) for i in range(1, 5)]
    v0, vc, vs = _swing(axes, S, first.next_foot, second, delta[1])
    shape = MEETING if first.a == 0.0 else PARALLEL if first.sin == 0.0 else SKEW
    elbow = _elbow(shape, first.cos, v0, vc, vs)
    if elbow is None or np.linalg.norm(vc) < FLAT:
        return None
    R = axes.rotation
    vectors = {
        "frame": frame.T, "foot": frame @ first.foot, "centre": R.T @ (S - axes.position),
        "tip_x": R.T @ normals[4].normal, "tip_z": R.T @ h[5], "v0": v0, "vc": vc, "vs": vs,
    }  # fmt: skip
    return {name: np.where(np.abs(v) < ROUND_OFF, 0.0, v) for name, v in vectors.items()} | {
        "a": first.a, "links": [(normal.cos, normal.sin) for normal in normals], "offsets": delta, "elbow": elbow,
        "length": abs(first.a) + np.abs([v0, vc, vs]).sum(), "shape": shape, "backwards": int(backwards),
    }  # fmt: skip


def _swing(axes: ScrewAxes, S: Array, origin: Array, basis: Array, delta: float) -> tuple[Array, Array, Array]:
    """v as a function of q3 + delta: the circle of S about axis 3, from `origin`, along rows of `basis`."""
    h, o = axes.axis[2], axes.point[2]
    along = o + ((S - o) @ h) * h
    out = S - along
    side = np.cross(h, out)
    c, s = np.cos(delta), np.sin(delta)
    return basis @ (along - origin), basis @ (c * out - s * side), basis @ (s * out + c * side)


def _elbow(shape: int, cos: float, v0: Array, vc: Array, vs: Array) -> tuple[float, float, float] | None:
    """Constant, amplitude and phase of |v|² (MEETING) or cos α1 v_z (PARALLEL) as functions of q3."""
    if shape == SKEW:
        return 0.0, 0.0, 0.0
    if shape == MEETING:
        constant, c, s = v0 @ v0 + vc @ vc, 2 * v0 @ vc, 2 * v0 @ vs
    else:
        constant, c, s = cos * v0[2], cos * vc[2], cos * vs[2]
    amplitude = math.hypot(c, s)
    return None if amplitude < FLAT else (float(constant), amplitude, math.atan2(s, c))
