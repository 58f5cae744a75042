"""The closed form of one pose in scalar Python: the branches within the limits.

`batch_closed_form` has the same equations for arrays, with what is left out here: goals at the edge of the workspace,
singular ones, and branches outside the limits. numpy is twenty times slower for one goal, and as much faster for many.
"""

from __future__ import annotations

from collections.abc import Callable
from math import acos, atan2, cos, inf, pi, sin, sqrt
from typing import TypeAlias

from lrm_math.arrays import Vector3
from lrm_math.ik.answer import JointLimits
from lrm_math.ik.goal import Rotation
from lrm_math.ik.pieper import AxisPair, PieperForm

NumberedBranches: TypeAlias = list[tuple[int, tuple[float, ...]]]
ScalarClosedForm: TypeAlias = Callable[[Rotation, Vector3], "NumberedBranches | None"]

TURN = 2.0 * pi
EDGE = 1e-10
"""Relative size below which a root or a radius is degenerate and left to `batch_closed_form`."""
JUST_BEFORE = 0.98
"""Share of its largest value that replaces a missed root."""
ROUND_OFF = 1e-10
"""rad: an angle this far beyond a limit is at the limit."""


def into_limits(q: float, lower: float, upper: float) -> float:
    """The angle within the limits equal to q modulo 2π (rad), infinite if there is none."""
    if upper + ROUND_OFF < q < lower - ROUND_OFF + TURN or upper + ROUND_OFF - TURN < q < lower - ROUND_OFF:
        return inf
    q -= TURN * ((q - lower + ROUND_OFF) // TURN)
    return max(lower, min(q, upper)) if q <= upper + ROUND_OFF else inf


def scalar_closed_form(form: PieperForm, limits: JointLimits, missed: float = 0.0) -> ScalarClosedForm | None:
    """The solver of a form: from rotation and position (m) to branches `(number, q)`, or None for degenerate goals.

    Itself None for skew axes, which need a polynomial of degree four.

    `missed`: where an equation misses a root by no more than this share of its largest value, both branches are given
    as they are shortly before they merge: seeds for an arm that may still have them.
    """
    if form.shape is AxisPair.SKEW:
        return None
    meeting, backwards = form.shape is AxisPair.MEETING, form.backwards
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = form.frame
    fx, fy, fz = form.foot
    ex, ey, ez = form.centre
    ix, iy, iz = form.tip_x
    kx, ky, kz = form.tip_z
    a1, a1_squared = form.a, form.a * form.a
    (c12, s12), (c23, s23), (c34, s34), (c45, s45), (c56, s56) = form.links
    d2, d3, d4, d5 = form.offsets
    (ox, oy, oz), (gx, gy, gz), (hx, hy, hz) = form.v0, form.vc, form.vs
    constant, amplitude, phase = form.elbow
    small = EDGE * form.length * form.length
    inside, outside = 1.0 - EDGE, 1.0 + max(EDGE, missed)
    order = slice(None, None, -1) if backwards else slice(None)
    (l1, l2, l3, l4, l5, l6), (u1, u2, u3, u4, u5, u6) = limits.lower[order], limits.upper[order]

    def branches(rotation: Rotation, position: Vector3) -> NumberedBranches | None:
        (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation
        px, py, pz = position
        if backwards:
            r01, r02, r12, r10, r20, r21 = r10, r20, r21, r01, r02, r12
            x, y, z = ex - px, ey - py, ez - pz
            px = py = pz = 0.0
        else:
            x, y, z = ex, ey, ez
        # centre S, last normal i and last axis k of the goal, along the first axis' frame
        x, y, z = (r00 * x + r01 * y + r02 * z + px, r10 * x + r11 * y + r12 * z + py, r20 * x + r21 * y + r22 * z + pz)
        Cx, Cy, Cz = ax * x + ay * y + az * z - fx, bx * x + by * y + bz * z - fy, cx * x + cy * y + cz * z - fz
        x, y, z = r00 * ix + r01 * iy + r02 * iz, r10 * ix + r11 * iy + r12 * iz, r20 * ix + r21 * iy + r22 * iz
        Ix, Iy, Iz = ax * x + ay * y + az * z, bx * x + by * y + bz * z, cx * x + cy * y + cz * z
        x, y, z = r00 * kx + r01 * ky + r02 * kz, r10 * kx + r11 * ky + r12 * kz, r20 * kx + r21 * ky + r22 * kz
        Kx, Ky, Kz = ax * x + ay * y + az * z, bx * x + by * y + bz * z, cx * x + cy * y + cz * z
        flat = Cx * Cx + Cy * Cy
        square = flat + Cz * Cz
        if flat < small:
            return None
        x3 = ((square if meeting else Cz) - constant) / amplitude
        if not -inside < x3 < inside:
            if not missed or not -outside < x3 < outside:
                return None
            x3 = max(-JUST_BEFORE, min(x3, JUST_BEFORE))
        theta = acos(x3)
        found: NumberedBranches = []
        for elbow, t3 in ((0, phase + theta), (4, phase - theta)):
            q3 = t3 - d3
            if not l3 <= q3 <= u3 and (q3 := into_limits(q3, l3, u3)) > u3:
                continue
            cos3, sin3 = cos(t3), sin(t3)
            vx = ox + gx * cos3 + hx * sin3
            vy = oy + gy * cos3 + hy * sin3
            vz = oz + gz * cos3 + hz * sin3
            round2 = vx * vx + vy * vy
            if round2 < small:
                return None
            if meeting:
                uy = (Cz - c12 * vz) / s12
                wy = c12 * uy - s12 * vz
                root = flat - wy * wy if flat < round2 else round2 - uy * uy
            else:
                ux = (square - a1_squared - round2 - vz * vz) / (2.0 * a1)
                wx = ux + a1
                root = flat - wx * wx if flat < round2 else round2 - ux * ux
            if root < small:
                largest = min(flat, round2)
                if root < -max(small, missed * largest):
                    continue
                if not missed:
                    return None
                root = (1.0 - JUST_BEFORE) * largest
            root = sqrt(root)
            for shoulder in (0, 2):
                if shoulder:
                    root = -root
                if meeting:
                    ux = wx = root
                else:
                    uy, wy = root, c12 * root
                t2 = atan2(uy * vx - ux * vy, ux * vx + uy * vy)
                q2 = t2 - d2
                if not l2 <= q2 <= u2 and (q2 := into_limits(q2, l2, u2)) > u2:
                    continue
                t1 = q1 = atan2(wx * Cy - wy * Cx, wx * Cx + wy * Cy)
                if not l1 <= q1 <= u1 and (q1 := into_limits(q1, l1, u1)) > u1:
                    continue
                # the last axis as the third link sees it
                cos1, sin1, cos2, sin2 = cos(t1), sin(t1), cos(t2), sin(t2)
                x, y = cos1 * Kx + sin1 * Ky, cos1 * Ky - sin1 * Kx
                y, z = c12 * y + s12 * Kz, c12 * Kz - s12 * y
                x, y = cos2 * x + sin2 * y, cos2 * y - sin2 * x
                y, z = c23 * y + s23 * z, c23 * z - s23 * y
                x, y = cos3 * x + sin3 * y, cos3 * y - sin3 * x
                mx, my, mz = x, c34 * y + s34 * z, c34 * z - s34 * y
                cos5 = (c45 * c56 - mz) / (s45 * s56)
                if not -inside < cos5 < inside:
                    if not -outside < cos5 < outside:
                        continue
                    if not missed:
                        return None
                    cos5 = max(-JUST_BEFORE, min(cos5, JUST_BEFORE))
                sin5 = s56 * sqrt(1.0 - cos5 * cos5)
                side = -c45 * cos5 * s56 - s45 * c56
                for wrist in (0, 1):
                    if wrist:
                        sin5 = -sin5
                    t4 = atan2(sin5 * my - side * mx, sin5 * mx + side * my)
                    q4 = t4 - d4
                    if not l4 <= q4 <= u4 and (q4 := into_limits(q4, l4, u4)) > u4:
                        continue
                    cos4, sin4 = cos(t4), sin(t4)
                    t5 = atan2(cos4 * mx + sin4 * my, c45 * (sin4 * mx - cos4 * my) - s45 * mz)
                    q5 = t5 - d5
                    if not l5 <= q5 <= u5 and (q5 := into_limits(q5, l5, u5)) > u5:
                        continue
                    # the last normal as the fifth link sees it
                    x, y = cos1 * Ix + sin1 * Iy, cos1 * Iy - sin1 * Ix
                    y, z = c12 * y + s12 * Iz, c12 * Iz - s12 * y
                    x, y = cos2 * x + sin2 * y, cos2 * y - sin2 * x
                    y, z = c23 * y + s23 * z, c23 * z - s23 * y
                    x, y = cos3 * x + sin3 * y, cos3 * y - sin3 * x
                    y, z = c34 * y + s34 * z, c34 * z - s34 * y
                    x, y = cos4 * x + sin4 * y, cos4 * y - sin4 * x
                    y, z = c45 * y + s45 * z, c45 * z - s45 * y
                    cos_t5, sin_t5 = cos(t5), sin(t5)
                    x, y = cos_t5 * x + sin_t5 * y, cos_t5 * y - sin_t5 * x
                    q6 = atan2(c56 * y + s56 * z, x)
                    if not l6 <= q6 <= u6 and (q6 := into_limits(q6, l6, u6)) > u6:
                        continue
                    q = (q6, q5, q4, q3, q2, q1) if backwards else (q1, q2, q3, q4, q5, q6)
                    found.append((elbow + shoulder + wrist, q))
        return found

    return branches
