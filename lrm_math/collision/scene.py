"""How close the arm's links come to each other and to what stands around them.

Links are capsules and surroundings boxes (`lrm_math.arm.collision_shapes`, from the arm's file). The distance of two
capsules is the distance of their axes less both radii; it is below zero where they overlap. That of a capsule and a
box likewise.

Frames are those of the nominal rigid arm. The real one sags: on the rig its tool was found 27 mm off on average, 60 mm
at most. The margin has to cover that, or `clearance_of` takes the frames of a model's elastic equilibrium.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arm.collision_shapes import Box, Capsule
from lrm_math.arrays import Array
from lrm_math.collision.distance import segment_to_box, segment_to_segment
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.chain import Chain, chain_of
from lrm_math.kinematics.forward import frames

Indices = NDArray[np.intp]
AT_ONCE = 500
"""Poses measured at once: as many as stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Clearance:
    """How close the closest two bodies are, for N poses.

    Attributes:
        distance: (N,), m, below zero where they overlap.
        first, second: (N,), names of the two bodies.
    """

    distance: Array
    first: NDArray[np.str_]
    second: NDArray[np.str_]


@dataclass(frozen=True)
class Closest:
    """The closest two bodies of one pose: their names and their distance (m), below zero where they overlap."""

    distance: float
    first: str
    second: str


@dataclass(frozen=True, eq=False)
class Scene:
    """An arm's shapes, ready to be measured.

    `frame` (C,) and `ends` (C, 2, 3): frame and axis of every capsule. `box_turn` (B, 3, 3), `box_centre` (B, 3),
    `box_half` (B, 3): the boxes in the frame of TCP positions. `links` (K, 2): pairs of capsules; `around` (M, 2):
    pairs of a capsule and a box; `gaps` (K + M,): both radii of a pair, or the one. `names` (K + M, 2).
    `sweep` (K + M, n): no angle of joint j that turns by 1 rad moves the one body against the other by more (m).
    """

    chain: Chain
    limits: Array
    margin: float
    frame: Indices
    ends: Array
    box_turn: Array
    box_centre: Array
    box_half: Array
    links: Indices
    around: Indices
    gaps: Array
    names: NDArray[np.str_]
    sweep: Array

    @classmethod
    def of(cls, arm: Arm, allow: Iterable[tuple[str, str]] = ()) -> Scene:
        """The shapes of an arm.

        Args:
            allow: names of further pairs that may touch, for instance a gripper and the ground it picks from.

        Raises:
            UnknownName: a name in `allow` that no shape has.
            LrmError: an arm without any two shapes that could touch.
        """
        shapes, chain = arm.shapes, chain_of(arm)
        allowed = {frozenset(pair) for pair in (*shapes.ignored, *allow)}
        for name in sorted(frozenset().union(*allowed)):
            if name not in shapes.names:
                raise UnknownName("shape", name, shapes.names)
        capsules, boxes = shapes.capsules, shapes.boxes

        def may_touch(one: Capsule, other: Capsule | Box) -> bool:
            apart = abs(one.frame - (other.frame if isinstance(other, Capsule) else 0))
            return apart > 1 and frozenset((one.name, other.name)) not in allowed

        links = [(i, j) for i, j in combinations(range(len(capsules)), 2) if may_touch(capsules[i], capsules[j])]
        around = [
            (i, k) for i, k in product(range(len(capsules)), range(len(boxes))) if may_touch(capsules[i], boxes[k])
        ]
        if not links and not around:
            raise LrmError(f"arm '{arm.name}': no [[capsule]] or [[box]] of its file could touch another")
        home = frames(chain, chain.values([0.0] * arm.dof), 1)[0]
        turns, centres = zip(*(_stands(box, home[0]) for box in boxes), strict=True) if boxes else ((), ())
        pairs = [sorted((capsules[i], capsules[j]), key=lambda c: c.frame) for i, j in links]
        return cls(
            chain=chain,
            limits=np.array([(joint.lower, joint.upper) for joint in arm.joints]).T,
            margin=shapes.margin,
            frame=np.array([c.frame for c in capsules], dtype=np.intp),
            ends=np.array([(c.start, c.end) for c in capsules], dtype=np.float64).reshape(-1, 2, 3),
            box_turn=np.array(turns, dtype=np.float64).reshape(-1, 3, 3),
            box_centre=np.array(centres, dtype=np.float64).reshape(-1, 3),
            box_half=0.5 * np.array([b.size for b in boxes], dtype=np.float64).reshape(-1, 3),
            links=np.array(links, dtype=np.intp).reshape(-1, 2),
            around=np.array(around, dtype=np.intp).reshape(-1, 2),
            gaps=np.array([a.radius + b.radius for a, b in pairs] + [capsules[i].radius for i, _ in around]),
            names=np.array(
                [(a.name, b.name) for a, b in pairs] + [(capsules[i].name, boxes[k].name) for i, k in around]
            ),
            sweep=np.array(
                [_sweep(chain, home, a.frame, b) for a, b in pairs]
                + [_sweep(chain, home, 0, capsules[i]) for i, _ in around]
            ),
        )

    def margin_or(self, margin: float | None) -> float:
        """A margin (m) that was asked for, or the arm's. Raises `LrmError` if it is below zero or not a number."""
        if margin is None:
            return self.margin
        if not 0.0 <= margin < np.inf:
            raise LrmError(f"the collision margin is {margin} m; it must be a number not below zero")
        return margin

    def pose(self, q: ArrayLike) -> Array:
        """(n,), the angles of one pose (rad). Raises `LrmError` for other shapes or what is not finite."""
        return self._angles(q, np.ndim(q) == 1)

    def poses(self, q: ArrayLike) -> Array:
        """(N, n), the angles of one pose (n,) or N (rad). Raises `LrmError` for other shapes or what is not finite."""
        return np.atleast_2d(self._angles(q, np.ndim(q) in (1, 2)))

    def _angles(self, q: ArrayLike, dimensions_fit: bool) -> Array:
        array = np.asarray(q, dtype=np.float64)
        if not dimensions_fit or array.shape[-1] != self.chain.dof or not np.isfinite(array).all():
            raise LrmError(
                f"joint angles of shape {array.shape}; should be finite, {self.chain.dof} for each pose (rad)"
            )
        return array

    def frames(self, q: Array) -> Array:
        """(N, n + 2, 4, 4), frames of the nominal rigid arm at angles q (N, n) in rad."""
        return frames(self.chain, self.chain.values(list(np.ascontiguousarray(q.T))), len(q))

    def distances(self, stands: Array) -> Array:
        """(N, K + M), distance of every pair (m) for frames (N, n + 2, 4, 4)."""
        place = stands[:, self.frame]
        ends = np.einsum("ncij,cej->ncei", place[..., :3, :3], self.ends) + place[:, :, None, :3, 3]
        (i, j), (c, k) = self.links.T, self.around.T
        one, other = ends[:, i], ends[:, j]
        seen = np.einsum("nmej,mji->nmei", ends[:, c] - self.box_centre[k, None], self.box_turn[k])
        apart = segment_to_segment(one[:, :, 0], one[:, :, 1], other[:, :, 0], other[:, :, 1])
        around = segment_to_box(seen[:, :, 0], seen[:, :, 1], self.box_half[k])
        return np.concatenate([apart, around], axis=1) - self.gaps

    def closest(self, q: ArrayLike) -> Closest:
        """The closest two bodies of one pose, angles q (n,) in rad. Raises `LrmError`."""
        return self.pair_of(self.distances(self.frames(self.pose(q)[None]))[0])

    def pair_of(self, distances: Array) -> Closest:
        """The closest pair, from the distances (K + M,) of all."""
        pair = int(np.argmin(distances))
        return Closest(float(distances[pair]), str(self.names[pair, 0]), str(self.names[pair, 1]))


def clearance(scene: Scene, q: ArrayLike) -> Clearance:
    """The closest two bodies of the nominal rigid arm at angles q (N, n) or (n,) in rad. Raises `LrmError`."""
    return clearance_of(scene, scene.frames(scene.poses(q)))


def clearance_of(scene: Scene, stands: Array) -> Clearance:
    """The closest two bodies for frames (N, n + 2, 4, 4): base, after joint 1 … n, tool, of whatever model (m).

    `walk.frames(model.chain, equilibrium(model, poses).slots, N)` are those of the arm that sags.

    Raises:
        LrmError: frames of another shape, or not finite.
    """
    if stands.shape[1:] != (scene.chain.dof + 2, 4, 4) or not np.isfinite(stands).all():
        raise LrmError(f"frames of shape {stands.shape}; should be finite, (N, {scene.chain.dof + 2}, 4, 4)")
    pair, distance = np.zeros(len(stands), dtype=np.intp), np.zeros(len(stands))
    for start in range(0, len(stands), AT_ONCE):
        block = slice(start, start + AT_ONCE)
        distances = scene.distances(stands[block])
        pair[block], distance[block] = distances.argmin(axis=1), distances.min(axis=1)
    return Clearance(distance, scene.names[pair, 0], scene.names[pair, 1])


def _stands(box: Box, base: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and centre (3,) of a box in the frame of TCP positions."""
    turn, centre = np.eye(3), np.array(box.centre)
    for axis, angle in enumerate(box.turn):
        turn = turn @ _rotation(axis, angle)
    return (base[:3, :3] @ turn, base[:3, :3] @ centre + base[:3, 3]) if box.in_base else (turn, centre)


def _rotation(axis: int, angle: float) -> Array:
    R = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i, i] = R[j, j] = np.cos(angle)
    R[j, i] = np.sin(angle)
    R[i, j] = -R[j, i]
    return R


def _sweep(chain: Chain, home: Array, still: int, capsule: Capsule) -> Array:
    """(n,), m/rad: the furthest that the capsule's axis can be from each joint's axis, in any pose.

    Joints up to frame number `still` move both bodies alike and count nothing. From one joint's axis to the next the
    link is as long in every pose; the way out to the capsule is never longer than those lengths together.
    """
    last = min(capsule.frame, chain.dof)
    ends = home[capsule.frame, :3, :3] @ np.array([capsule.start, capsule.end]).T + home[capsule.frame, :3, 3:]
    out, reach = np.zeros(chain.dof), 0.0
    for joint in range(last, still, -1):
        before = home[joint - 1]
        points = before[:3, :3].T @ (ends - before[:3, 3:])
        out[joint - 1] = np.hypot(points[0], points[1]).max() + reach
        reach += np.linalg.norm(points, axis=0).max()
        ends = before[:3, 3:]
    return out
