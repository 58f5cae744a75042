"""Distances of an arm's bodies with no code of the guard: link matrices, and points of each axis against every solid.

Nine points of an axis, then nine about the nearest of them, and so on: exact to 10 um, as the distance to a box, or to
a segment, is convex along an axis. Rows that are far away are not refined.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arm.collision_shapes import WORLD, Box, Capsule, HeightField, Obstacle
from lrm_math.arrays import Array
from tests.support.link_matrices import shift, turn

POINTS, ROUNDS = 9, 6
Signed: TypeAlias = Callable[[Array, Array], Array]
"""Distance, below zero inside, of points (M, P, 3) to a solid; of the rows (M,) of a motion."""


def link_frames(arm: Arm, q: Array) -> Array:
    """(L + 2, N, 4, 4), frames of an arm without followers at angles q (N, n), rad: base, links, tool."""
    assert not arm.mimics
    b, t = arm.base, arm.tool
    here = np.repeat((shift(b.x, b.y, b.z) @ turn(0, b.alpha) @ turn(1, b.beta) @ turn(2, b.gamma))[None], len(q), 0)
    out = [here]
    for joint, angles in zip(arm.joints, q.T, strict=True):
        rotated = np.array([turn(2, joint.theta + angle) for angle in angles.tolist()])
        link = shift(0, 0, joint.d) @ shift(joint.a, 0, 0) @ turn(0, joint.alpha) @ turn(1, joint.beta)
        here = here @ (rotated @ (link @ shift(0, 0, joint.extra_z or 0.0)))
        out.append(here)
    out.append(here @ (turn(0, t.alpha) @ turn(1, t.beta) @ turn(2, t.gamma) @ shift(t.x, t.y, t.z)))
    return np.array(out)


def bodies_apart(arm: Arm, placed: Array, around: Sequence[Obstacle], below: float) -> dict[tuple[str, str], Array]:
    """Distances (N,), m, of every pair that may collide, for frames (L + 2, N, 4, 4).

    Those that are larger than `below` are known to be so, and not how large they are.
    A map without a column is in no pair."""
    capsules = (*arm.shapes.capsules, *(one for one in around if isinstance(one, Capsule)))
    solids = (*arm.shapes.boxes, *(one for one in around if not isinstance(one, Capsule)))
    axes = {c.name: _axis(c, placed) for c in capsules}
    carrier = {c.name: 0 if c.frame == WORLD else c.frame for c in capsules} | {s.name: 0 for s in solids}
    found: dict[tuple[str, str], Array] = {}

    def add(capsule: Capsule, other: Obstacle, signed: Sequence[Signed], radius: float) -> None:
        apart = abs(carrier[capsule.name] - carrier[other.name]) > 1
        if apart and signed and (capsule.name, other.name) not in arm.shapes.ignored:
            nearest = [_least(*axes[capsule.name], one, below + radius) for one in signed]
            found[capsule.name, other.name] = np.min(nearest, axis=0) - radius

    for number, capsule in enumerate(capsules):
        for other in capsules[number + 1 :]:
            add(capsule, other, [_to_segment(*axes[other.name])], capsule.radius + other.radius)
        for solid in solids:
            add(capsule, solid, _to_solid(solid, placed[0, 0]), capsule.radius)
    return found


def _axis(capsule: Capsule, placed: Array) -> tuple[Array, Array]:
    """(N, 3) each, both ends of a capsule's axis."""
    frame = np.repeat(np.eye(4)[None], placed.shape[1], 0) if capsule.frame == WORLD else placed[capsule.frame]
    start, end = (frame[:, :3, :3] @ np.array(at) + frame[:, :3, 3] for at in (capsule.start, capsule.end))
    return start, end


def _least(a: Array, b: Array, signed: Signed, below: float) -> Array:
    """(N,), the least of the signed distances of points of segments a-b, (N, 3) each."""
    rows, low, high = np.arange(len(a)), np.zeros(len(a)), np.ones(len(a))
    out = np.full(len(a), np.inf)
    for _ in range(ROUNDS + 1):
        share = low[:, None] + np.linspace(0.0, 1.0, POINTS) * (high - low)[:, None]
        apart = signed(rows, a[rows, None] + share[..., None] * (b - a)[rows, None])
        best = apart.argmin(axis=1)
        out[rows] = np.minimum(out[rows], apart.min(axis=1))
        spacing = (high - low) / (POINTS - 1)
        at = share[np.arange(len(rows)), best]
        near = out[rows] - 0.5 * spacing * np.linalg.norm((b - a)[rows], axis=1) < below
        rows, low, high = rows[near], (np.maximum(at - spacing, 0.0))[near], (np.minimum(at + spacing, 1.0))[near]
    return out


def _to_segment(start: Array, end: Array) -> Signed:
    def signed(rows: Array, points: Array) -> Array:
        along = (end - start)[rows, None]
        share = ((points - start[rows, None]) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-18)
        nearest = start[rows, None] + np.clip(share, 0.0, 1.0)[..., None] * along
        return np.asarray(np.linalg.norm(points - nearest, axis=-1))

    return signed


def _to_solid(solid: Obstacle, base: Array) -> list[Signed]:
    """Of a box the signed distance; of a heightfield that to each column: each is convex, all together are not."""
    assert isinstance(solid, Box | HeightField)
    rotation = turn(0, solid.rotation[0]) @ turn(1, solid.rotation[1]) @ turn(2, solid.rotation[2])
    if isinstance(solid, Box):
        frame = (base if solid.in_base else np.eye(4)) @ shift(*solid.centre) @ rotation
        half = 0.5 * np.array(solid.size)

        def signed(_: Array, points: Array) -> Array:
            beyond = np.abs((points - frame[:3, 3]) @ frame[:3, :3]) - half
            outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
            return np.asarray(outside + np.minimum(beyond.max(axis=-1), 0.0))

        return [signed]
    frame = shift(*solid.origin) @ rotation
    cells = [(i, j, high) for i, row in enumerate(solid.heights) for j, high in enumerate(row) if high > -np.inf]
    return [_to_column(frame, solid.cell, *cell) for cell in cells]


def _to_column(frame: Array, cell: float, i: int, j: int, high: float) -> Signed:
    """Of the column in row i and place j of a grid, without end below."""

    def above(_: Array, points: Array) -> Array:
        local = (points - frame[:3, 3]) @ frame[:3, :3]
        sides = [np.abs(local[..., axis] - (k + 0.5) * cell) - 0.5 * cell for axis, k in ((0, j), (1, i))]
        return np.sqrt(sum(np.maximum(gap, 0.0) ** 2 for gap in (*sides, local[..., 2] - high)))

    return above
