"""The closed form of many poses at once, in numpy: all branches, degenerate ones too.

The equations are those of `pieper` and `scalar_closed_form`. Branches are rows: every root doubles the rows, and those
that do not exist or lie outside the window are dropped as soon as that is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from lrm_math.arrays import Array
from lrm_math.ik.linkage import Indices
from lrm_math.ik.pieper import AxisPair, CosSin, PieperForm
from lrm_math.ik.quartic import skew_elbow
from lrm_math.ik.scalar_closed_form import ROUND_OFF
from lrm_math.ik.solver import Mask

VectorComponents: TypeAlias = tuple[Array, Array, Array]
CosSins: TypeAlias = list[tuple[Array, Array]]

SLACK = 1e-12
"""Share of the arm's length, or of 1 for a cosine, by which a goal at the edge of the workspace may lie beyond it."""
DEGENERATE, DEGENERATE_ROOT = 1e-9, 1e-7
"""Share of the arm's length, or of 1, below which a lever no longer determines its joint's angle; the second where the
lever is itself a root, which turns round-off into its square root.
"""
ILL_CONDITIONED = 1e-5
"""Share of the arm's length below which such a lever determines its joint's angle badly."""
SIGNS = np.array([[1.0], [-1.0]])
TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class AllBranches:
    """The branches of N poses.

    `q`: (N, 8, 6), rad, modulo 2π nearest to the middle of the limits; zero where there is no branch. `exists`: (N, 8).
    `free`: (N, 8), number from 0 of a joint whose angle is arbitrary there, or -1. `ill_conditioned`: (N, 8), whether
    round-off may exceed a picometre.
    """

    q: Array
    exists: Mask
    free: Indices
    ill_conditioned: Mask


@dataclass(frozen=True, eq=False)
class AngleWindow:
    """Accepted angles, joints in the order of the form: each (6,), rad; ±inf where all are."""

    middle: Array
    lower: Array
    upper: Array

    @classmethod
    def of(cls, form: PieperForm, lower: Array, upper: Array, limited: bool) -> AngleWindow:
        """The limits, or all angles."""
        order = slice(None, None, -1) if form.backwards else slice(None)
        more = 0.0 if limited else np.inf
        return cls(0.5 * (lower + upper)[order], lower[order] - more, upper[order] + more)

    def wrapped(self, joint: int, q: Array) -> tuple[Array, Mask]:
        """Angles of one joint modulo 2π nearest to the middle, and which are accepted."""
        q = q - TURN * np.rint((q - self.middle[joint]) / TURN)
        return q, (q >= self.lower[joint] - ROUND_OFF) & (q <= self.upper[joint] + ROUND_OFF)


def all_branches(form: PieperForm, positions: Array, rotations: Array, at: Array, window: AngleWindow) -> AllBranches:
    """The branches of N poses that lie in a window.

    `positions`: (N, 3), m. `rotations`: (N, 3, 3). `at`: (6,) or (N, 6), values of undetermined joints (rad).
    """
    count = len(positions)
    order = slice(None, None, -1) if form.backwards else slice(None)
    at = np.broadcast_to(at[..., order], (count, 6)).T
    C, normal, axis = _in_first_frame(form, positions, rotations)
    first, turns, goal, number, free, ill_conditioned = _place_centre(form, C, at, window)
    tip = _through_three(form, normal[:, goal], turns), _through_three(form, axis[:, goal], turns)
    last, row, wrist, turning = _orient_tool(form, *tip, at[3][goal], window)
    goal, number = goal[row], number[row] + wrist
    free = np.where(free[row] >= 0, free[row], turning)
    shape = (count, 8)
    out = AllBranches(np.zeros((*shape, 6)), np.zeros(shape, np.bool_), np.full(shape, -1), np.zeros(shape, np.bool_))
    rows = np.concatenate([first[:, row], last]).T
    out.q[goal, number] = np.clip(rows, window.lower, window.upper)[:, order]
    out.exists[goal, number], out.ill_conditioned[goal, number] = True, ill_conditioned[row]
    out.free[goal, number] = np.where(free >= 0, 5 - free, free) if form.backwards else free
    return out


def _in_first_frame(form: PieperForm, p: Array, R: Array) -> VectorComponents:
    """Wrist centre S (m), last common normal and last axis of every goal in the first axis' frame, each (3, N)."""
    frame, centre = np.array(form.frame), np.array(form.centre)
    seen = R.swapaxes(1, 2) if form.backwards else R
    S = np.einsum("nij,nj->ni", seen, centre - p) if form.backwards else seen @ centre + p
    tips = (seen @ np.array(form.tip_x), seen @ np.array(form.tip_z))
    return frame @ S.T - np.array(form.foot)[:, None], frame @ tips[0].T, frame @ tips[1].T


def _place_centre(
    form: PieperForm, C: Array, at: Array, window: AngleWindow
) -> tuple[Array, CosSins, Indices, Indices, Indices, Mask]:
    """The first three joints, which bring S to C.

    Returns:
        q1, q2, q3 (3, M); (cos, sin) of the angles between normals; goal, number and free joint (-1 none) of each row,
        and whether it is ill-conditioned.
    """
    flat = C[0] ** 2 + C[1] ** 2
    t3, exists = _elbow(form, C[2], flat + C[2] ** 2)
    q3, accepted = window.wrapped(2, t3 - form.offsets[1])
    elbow, goal = np.nonzero(exists & accepted)
    t3, q3 = t3[elbow, goal], q3[elbow, goal]
    turn3 = np.cos(t3), np.sin(t3)
    vx, vy, vz = (v0 + vc * turn3[0] + vs * turn3[1] for v0, vc, vs in zip(form.v0, form.vc, form.vs, strict=True))
    Cx, Cy, Cz = C[:, goal]
    flat, round2 = flat[goal], vx**2 + vy**2
    ux, uy, seen = _shoulder(form, Cz, flat, round2, vz)
    cos, sin = form.links[0]
    wx, wy = ux + form.a, cos * uy - sin * vz
    lost1, lost2 = flat < (DEGENERATE * form.length) ** 2, round2 < (DEGENERATE_ROOT * form.length) ** 2
    t2 = np.arctan2(uy * vx - ux * vy, ux * vx + uy * vy)
    t1 = np.arctan2(wx * Cy - wy * Cx, wx * Cx + wy * Cy)
    if lost1.any() or lost2.any():
        t1, t2 = np.where(lost1, at[0][goal], t1), np.where(lost2, at[1][goal] + form.offsets[0], t2)
        seen[1:] &= ~(lost1 | lost2)
    q2, accepted2 = window.wrapped(1, t2 - form.offsets[0])
    q1, accepted1 = window.wrapped(0, t1)
    shoulder, row = np.nonzero(seen & accepted2 & accepted1)
    free = np.where(lost1, 0, np.where(lost2, 1, -1))[row]
    q1, q2 = q1[shoulder, row], q2[shoulder, row]
    t2 = q2 + form.offsets[0]
    turns = [(np.cos(q1), np.sin(q1)), (np.cos(t2), np.sin(t2)), (turn3[0][row], turn3[1][row])]
    number = (2 * elbow if form.shape is AxisPair.SKEW else 4 * elbow)[row] + 2 * shoulder
    ill_conditioned = round2[row] < (ILL_CONDITIONED * form.length) ** 2
    return np.stack([q1, q2, q3[row]]), turns, goal[row], number, free, ill_conditioned


def _elbow(form: PieperForm, height: Array, square: Array) -> tuple[Array, Mask]:
    """Angles t3 and whether they exist, both (2, N), or (4, N) for skew axes."""
    if form.shape is AxisPair.SKEW:
        return skew_elbow(form, height, square)
    constant, amplitude, phase = form.elbow
    cos = ((square if form.shape is AxisPair.MEETING else height) - constant) / amplitude
    return phase + SIGNS * np.arccos(np.clip(cos, -1.0, 1.0)), np.abs(cos) <= 1.0 + SLACK


def _shoulder(form: PieperForm, height: Array, flat: Array, round2: Array, vz: Array) -> tuple[Array, Array, Mask]:
    """u_x, u_y (m) of M rows, and whether they exist: (2, M) with both roots, (1, M) for skew axes."""
    cos, sin = form.links[0]
    if form.shape is not AxisPair.PARALLEL:
        uy = (height - cos * vz) / sin
    if form.shape is not AxisPair.MEETING:
        ux = (flat + height**2 - form.a**2 - round2 - vz**2) / (2.0 * form.a)
    if form.shape is AxisPair.MEETING:
        root, seen = _root(form, flat, cos * uy - sin * vz, round2, uy)
        return SIGNS * root, uy, np.stack([seen, seen])
    if form.shape is AxisPair.PARALLEL:
        root, seen = _root(form, flat, ux + form.a, round2, ux)
        return ux, SIGNS * root, np.stack([seen, seen])
    return ux[None], uy[None], np.ones((1, len(ux)), dtype=np.bool_)


def _root(form: PieperForm, flat: Array, w: Array, round2: Array, u: Array) -> tuple[Array, Mask]:
    """√(flat - w²) = √(round2 - u²) (m): of the two equal differences the one with the smaller numbers."""
    short = flat < round2
    larger = np.where(short, flat, round2)
    square = larger - np.where(short, w, u) ** 2
    seen = square >= -SLACK * form.length * (np.sqrt(larger) + SLACK * form.length)
    return np.sqrt(np.maximum(square, 0.0)), seen


def _through_three(form: PieperForm, v: Array, turns: CosSins) -> VectorComponents:
    """A direction (3, M) of the first axis' frame in that of link 3."""
    x, y, z = v
    for joint, link in zip(turns, form.links[:3], strict=True):
        x, y, z = _into_link(x, y, z, joint, link)
    return x, y, z


def _into_link(x: Array, y: Array, z: Array, joint: tuple[Array, Array], link: CosSin) -> VectorComponents:
    """Transform of a vector across one joint and its link: Rx(-α) Rz(-t) v."""
    (c, s), (cos, sin) = joint, link
    x, y = c * x + s * y, c * y - s * x
    if cos == 0.0:
        return x, sin * z, -sin * y
    return x, cos * y + sin * z, cos * z - sin * y


def _orient_tool(
    form: PieperForm, normal: VectorComponents, axis: VectorComponents, at: Array, window: AngleWindow
) -> tuple[Array, Indices, Indices, Indices]:
    """The last three joints, which orient the tool.

    Returns:
        q4, q5, q6 (3, M'); row among the M given, number (0, 1) and free joint (-1 none) of each.
    """
    (c45, s45), (c56, s56) = form.links[3:]
    mx, my, mz = axis
    cos5 = (c45 * c56 - mz) / (s45 * s56)
    exists = np.abs(cos5) <= 1.0 + SLACK
    cos5 = np.clip(cos5, -1.0, 1.0)
    sin5 = s56 * np.sqrt(np.maximum(1.0 - cos5**2, SLACK**2)) * SIGNS
    side = -c45 * cos5 * s56 - s45 * c56
    t4 = np.arctan2(sin5 * my - side * mx, sin5 * mx + side * my)
    degenerate = mx**2 + my**2 < DEGENERATE**2
    if degenerate.any():
        t4 = np.where(degenerate, at + form.offsets[2], t4)
    q4, accepted = window.wrapped(3, t4 - form.offsets[2])
    wrist, row = np.nonzero(np.stack([exists & accepted[0], exists & accepted[1] & ~degenerate]))
    q4, t4 = q4[wrist, row], t4[wrist, row]
    turn4 = np.cos(t4), np.sin(t4)
    x, y, _ = _into_link(mx[row], my[row], mz[row], turn4, form.links[3])
    q5, accepted = window.wrapped(4, np.arctan2(x, -y) - form.offsets[3])
    if not accepted.all():
        row, wrist, q4, q5 = row[accepted], wrist[accepted], q4[accepted], q5[accepted]
        turn4 = tuple(t[accepted] for t in turn4)
    t5 = q5 + form.offsets[3]
    nx, ny, nz = (component[row] for component in normal)
    x, y, _ = _into_link(*_into_link(nx, ny, nz, turn4, form.links[3]), (np.cos(t5), np.sin(t5)), form.links[4])
    q6, accepted = window.wrapped(5, np.arctan2(y, x))
    turning = np.where(degenerate[row], 3, -1)
    return np.stack([q4, q5, q6])[:, accepted], row[accepted], wrist[accepted], turning[accepted]
