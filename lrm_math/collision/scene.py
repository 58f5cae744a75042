"""Collision scene: distances between the arm's links, and from them to obstacles.

Links are capsules and obstacles boxes (`lrm_math.arm.collision_shapes`, from the arm's file). The distance of two
capsules is the distance of their axes less both radii; it is below zero where they overlap. That of a capsule and a
box, or the columns of a heightfield, likewise.

Frames are those of the nominal rigid arm. The real arm deflects: on the rig its tool was 27 mm off on average, 60 mm at
most. The margin has to cover that, or `clearance_of` takes the frames of a model's elastic equilibrium.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arm.collision_shapes import WORLD, Box, Capsule, HeightField, Obstacle
from lrm_math.arrays import Array, Vector3
from lrm_math.collision.contact import ContactPermit
from lrm_math.collision.distance import depth_in_box, segment_to_box, segment_to_segment
from lrm_math.collision.height_grid import HeightGrid
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.chain import Chain, chain_of, rotation_about
from lrm_math.kinematics.forward import frames

Indices = NDArray[np.intp]
BATCH = 500
"""Poses computed at once: as many as stay in the processor's cache."""
TOUCHING = 1e-9
"""m: an axis that is nearer to an obstacle lies in it; where it crosses one, its distance is 0 but for rounding."""


@dataclass(frozen=True, eq=False)
class Clearance:
    """The distance of the closest two bodies, for N poses.

    Attributes:
        distance: (N,), m, below zero where they overlap.
        first, second: (N,), names of the two bodies.
    """

    distance: Array
    first: NDArray[np.str_]
    second: NDArray[np.str_]


@dataclass(frozen=True)
class ClosestPair:
    """The closest two bodies of one pose: their names and their distance (m), below zero where they overlap."""

    distance: float
    first: str
    second: str


@dataclass(frozen=True, eq=False)
class PlacedGrid:
    """A heightfield of the scene: its `grid`, `rotation` (3, 3) and `origin` (3,), m, in the frame of TCP positions;
    numbers of the `capsules` that may touch it."""

    grid: HeightGrid
    rotation: Array
    origin: Array
    capsules: Indices

    @classmethod
    def of(cls, shape: HeightField, capsules: Sequence[int]) -> PlacedGrid:
        """A heightfield that some capsules may touch."""
        grid = HeightGrid(np.array(shape.heights, dtype=np.float64), shape.cell)
        return cls(grid, _rotation(shape.rotation), np.array(shape.origin), np.array(capsules, dtype=np.intp))

    def separations(self, ends: Array, with_depth: bool) -> Array:
        """(N, C), m, of axes `ends` (N, C, 2, 3) from the columns; `with_depth`: less the depth of an axis in them."""
        a, b = (((ends - self.origin) @ self.rotation).reshape(-1, 2, 3)[:, k] for k in (0, 1))
        apart = self.grid.distance(a, b)
        inside = apart <= TOUCHING
        if with_depth and inside.any():
            apart[inside] -= self.grid.depth(a[inside], b[inside])
        return np.asarray(apart.reshape(ends.shape[:2]))


@dataclass(frozen=True, eq=False)
class Scene:
    """An arm's shapes as arrays, and the pairs of them that may collide.

    `frame` (C,) and `ends` (C, 2, 3): frame and axis of every capsule. `box_rotation` (B, 3, 3), `box_centre` (B, 3),
    `box_half` (B, 3): the boxes in the frame of TCP positions. `capsule_pairs` (K, 2); `box_pairs` (M, 2): pairs of a
    capsule and a box; `grids`: heightfields, with F pairs in all. Of the P = K + M + F pairs: `radii` (P,), their sum,
    `names` (P, 2), `motion_bound` (P, n): the most that 1 rad of joint j can move the one body against the other (m).
    `home` (n + 2, 4, 4): `frames` with all angles zero. `estimated`: names of shapes that nobody measured. `around`:
    those of obstacles beside the arm file's. `permits`: contacts that are allowed, by the number of their pair; the
    distances of these pairs are raised where they are.
    """

    chain: Chain
    limits: Array
    margin: float
    frame: Indices
    ends: Array
    box_rotation: Array
    box_centre: Array
    box_half: Array
    capsule_pairs: Indices
    box_pairs: Indices
    grids: tuple[PlacedGrid, ...]
    radii: Array
    names: NDArray[np.str_]
    motion_bound: Array
    home: Array
    estimated: frozenset[str] = frozenset()
    around: frozenset[str] = frozenset()
    permits: Mapping[int, ContactPermit] = field(default_factory=dict)

    @classmethod
    def of(cls, arm: Arm, allow: Iterable[tuple[str, str]] = (), around: Sequence[Obstacle] = ()) -> Scene:
        """The shapes of an arm.

        Args:
            allow: names of further pairs that may collide, for instance a gripper and the ground it picks from.
            around: further obstacles; their capsules have the frame `WORLD`.

        Raises:
            UnknownName: a name in `allow` that no shape has.
            LrmError: an arm without any two shapes that could collide.
        """
        shapes, chain = arm.shapes, chain_of(arm)
        allowed = {frozenset(pair) for pair in (*shapes.ignored, *allow)}
        for name in sorted(frozenset().union(*allowed)):
            if name not in shapes.names:
                raise UnknownName("shape", name, shapes.names)
        capsules = (*shapes.capsules, *(shape for shape in around if isinstance(shape, Capsule)))
        boxes = (*shapes.boxes, *(shape for shape in around if isinstance(shape, Box)))
        fields = [shape for shape in around if isinstance(shape, HeightField)]

        # neighbouring links always touch at their joint; what stands around the arm counts as carried by joint 0
        def checked(capsule: Capsule, other: Obstacle) -> bool:
            joints_between = abs(_carrier(capsule) - (_carrier(other) if isinstance(other, Capsule) else 0))
            return joints_between > 1 and frozenset((capsule.name, other.name)) not in allowed

        numbers = range(len(capsules))
        capsule_pairs = [(i, j) for i, j in combinations(numbers, 2) if checked(capsules[i], capsules[j])]
        box_pairs = [(i, k) for i, k in product(numbers, range(len(boxes))) if checked(capsules[i], boxes[k])]
        if not capsule_pairs and not box_pairs:
            raise LrmError(f"arm '{arm.name}': no [[capsule]] or [[box]] of its file could touch another")
        grids = [PlacedGrid.of(field, [i for i in numbers if checked(capsules[i], field)]) for field in fields]
        home = frames(chain, chain.values([0.0] * arm.dof), 1)[0]
        rotations, centres = zip(*(_box_pose(box, home[0]) for box in boxes), strict=True) if boxes else ((), ())
        inner_first = [sorted((capsules[i], capsules[j]), key=_carrier) for i, j in capsule_pairs]
        with_obstacle: list[tuple[Capsule, Obstacle]] = [
            *((capsules[i], boxes[k]) for i, k in box_pairs),
            *((capsules[i], field) for grid, field in zip(grids, fields, strict=True) for i in grid.capsules),
        ]
        pairs = [
            *(
                (a.name, b.name, a.radius + b.radius, _motion_bound(chain, home, _carrier(a), b))
                for a, b in inner_first
            ),
            *((c.name, other.name, c.radius, _motion_bound(chain, home, 0, c)) for c, other in with_obstacle),
        ]
        return cls(
            chain=chain,
            limits=np.array([(joint.lower, joint.upper) for joint in arm.joints]).T,
            margin=shapes.margin,
            frame=np.array([c.frame for c in capsules], dtype=np.intp),
            ends=np.array([(c.start, c.end) for c in capsules], dtype=np.float64).reshape(-1, 2, 3),
            box_rotation=np.array(rotations, dtype=np.float64).reshape(-1, 3, 3),
            box_centre=np.array(centres, dtype=np.float64).reshape(-1, 3),
            box_half=0.5 * np.array([b.size for b in boxes], dtype=np.float64).reshape(-1, 3),
            capsule_pairs=np.array(capsule_pairs, dtype=np.intp).reshape(-1, 2),
            box_pairs=np.array(box_pairs, dtype=np.intp).reshape(-1, 2),
            grids=tuple(grids),
            radii=np.array([radii for _, _, radii, _ in pairs]),
            names=np.array([(first, second) for first, second, _, _ in pairs]),
            motion_bound=np.array([bound for _, _, _, bound in pairs]),
            home=home,
            estimated=shapes.estimated,
            around=frozenset(shape.name for shape in around),
        )

    def permitting(self, permits: Iterable[ContactPermit]) -> Scene:
        """The scene in which some contacts of the arm with what is around it are allowed, and the others as before.

        Raises `LrmError`: two parts of the arm; a name that no shape has (`UnknownName`).
        """
        numbers = {frozenset(pair): k for k, pair in enumerate(self.names.tolist())}
        bodies = sorted(frozenset().union(*numbers))
        permits_by_body: dict[int, ContactPermit] = {}
        for permit in permits:
            for name in (permit.first, permit.second):
                if name not in bodies:
                    raise UnknownName("shape", name, bodies)
            number = numbers.get(permit.pair)
            if number is not None and number < len(self.capsule_pairs) and not self._with_obstacle(number):
                raise LrmError(f"{permit.first} and {permit.second} are both of the arm: they may never touch")
            if number is not None:
                permits_by_body[number] = permit
        tip = Capsule("tip", self.chain.dof + 1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1e-9)
        # a permission depends on where the tip is, so that the distance may change as fast as the tip moves
        bound = self.motion_bound.copy()
        bound[[*permits_by_body]] = np.maximum(bound[[*permits_by_body]], _motion_bound(self.chain, self.home, 0, tip))
        return replace(self, permits=permits_by_body, motion_bound=bound)

    def _with_obstacle(self, pair: int) -> bool:
        return bool((self.frame[self.capsule_pairs[pair]] == WORLD).any())

    @property
    def curved(self) -> NDArray[np.bool_]:
        """(P,), whether the distance of a pair is a plain one, whose curvature along a motion is bounded."""
        return np.isin(np.arange(len(self.radii)), [*self.permits], invert=True)

    def margin_or_default(self, margin: float | None) -> float:
        """The margin (m) given, or the arm's. Raises `LrmError` if it is below zero or not a number."""
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
        """(N, L + 2, 4, 4), frames of the nominal rigid arm at angles q (N, n) in rad.

        Joint j turns frame j - 1 about its z axis (Denavit & Hartenberg 1955); all else on its link is constant.
        """
        # a joint that follows others turns by their angles times its ratios
        turns = q @ self.chain.turns.T if self.chain.couplings else q
        cosines, sines = np.cos(turns), np.sin(turns)
        out = np.empty((len(q), *self.home.shape))
        out[:, 0] = here = np.broadcast_to(self.home[0], out[:, 0].shape)
        for j, link in enumerate(self._links):
            if j < turns.shape[1]:
                c, s = cosines[:, j, None], sines[:, j, None]
                turned = here.copy()
                # rotation about z on the right: new x = c x + s y, new y = c y − s x; z and origin stay
                turned[:, :, 0], turned[:, :, 1] = (
                    c * here[..., 0] + s * here[..., 1],
                    c * here[..., 1] - s * here[..., 0],
                )
                here = turned
            out[:, j + 1] = here = here @ link
        return out

    @cached_property
    def _links(self) -> Array:
        """(n + 1, 4, 4), every frame in the one before it, with all angles zero."""
        return np.asarray(np.linalg.inv(self.home[:-1]) @ self.home[1:])

    def distances(self, arm_frames: Array) -> Array:
        """(N, P), distance of every pair (m) for frames (N, n + 2, 4, 4); not below minus the radii of a pair."""
        return self._permitted(self._apart(arm_frames, with_depth=False), arm_frames)

    def separations(self, arm_frames: Array) -> Array:
        """(N, P), `distances`, less the depth of an axis that lies in an obstacle: they fall as it goes in deeper."""
        return self._permitted(self._apart(arm_frames, with_depth=True), arm_frames)

    def _permitted(self, separations: Array, arm_frames: Array) -> Array:
        """The separations, raised where a contact is permitted."""
        tips = arm_frames[:, -1, :3, 3]
        for pair, permit in self.permits.items():
            separations[:, pair] = permit.applied(separations[:, pair], tips, self.margin)
        return separations

    def _apart(self, arm_frames: Array, with_depth: bool) -> Array:
        """(N, P), m, of every pair; `with_depth`: less the depth of an axis in a box or in the columns of a grid."""
        if (self.frame == WORLD).any():
            world = np.broadcast_to(np.eye(4), (len(arm_frames), 1, 4, 4))
            arm_frames = np.concatenate([arm_frames, world], axis=1)
        place = arm_frames[:, self.frame]
        ends = np.einsum("ncij,cej->ncei", place[..., :3, :3], self.ends) + place[:, :, None, :3, 3]
        (i, j), (c, k) = self.capsule_pairs.T, self.box_pairs.T
        first, other = ends[:, i], ends[:, j]
        apart = segment_to_segment(first[:, :, 0], first[:, :, 1], other[:, :, 0], other[:, :, 1])
        # axes of capsules in the frame of each box, whose edges are then parallel to the coordinates
        in_box = np.einsum("nmej,mji->nmei", ends[:, c] - self.box_centre[k, None], self.box_rotation[k])
        a, b, half = in_box[:, :, 0], in_box[:, :, 1], self.box_half[k]
        to_boxes = segment_to_box(a, b, half)
        inside = to_boxes <= TOUCHING
        if with_depth and inside.any():
            to_boxes[inside] -= depth_in_box(a[inside], b[inside], np.broadcast_to(half, a.shape)[inside])
        to_grids = [grid.separations(ends[:, grid.capsules], with_depth) for grid in self.grids]
        return np.concatenate([apart, to_boxes, *to_grids], axis=1) - self.radii

    def closest(self, q: ArrayLike) -> ClosestPair:
        """The closest two bodies of one pose, angles q (n,) in rad. Raises `LrmError`."""
        return self.closest_pair(self.distances(self.frames(self.pose(q)[None]))[0])

    def closest_pair(self, distances: Array) -> ClosestPair:
        """The closest pair, from the distances (P,) of all pairs."""
        pair = int(np.argmin(distances))
        return ClosestPair(float(distances[pair]), str(self.names[pair, 0]), str(self.names[pair, 1]))


def clearance(scene: Scene, q: ArrayLike) -> Clearance:
    """The closest two bodies of the nominal rigid arm at angles q (N, n) or (n,) in rad. Raises `LrmError`."""
    return clearance_of(scene, scene.frames(scene.poses(q)))


def clearance_of(scene: Scene, arm_frames: Array) -> Clearance:
    """The closest two bodies for frames (N, L + 2, 4, 4) of any model: base, after link 1 … L, tool (m).

    `frames(model.chain, equilibrium(model, poses).slots, N)` are those of the elastic arm.

    Raises:
        LrmError: frames of another shape, or not finite.
    """
    count = len(scene.chain.frame_ends)
    if arm_frames.shape[1:] != (count, 4, 4) or not np.isfinite(arm_frames).all():
        raise LrmError(f"frames of shape {arm_frames.shape}; should be finite, (N, {count}, 4, 4)")
    pair, distance = np.zeros(len(arm_frames), dtype=np.intp), np.zeros(len(arm_frames))
    for start in range(0, len(arm_frames), BATCH):
        block = slice(start, start + BATCH)
        distances = scene.distances(arm_frames[block])
        pair[block], distance[block] = distances.argmin(axis=1), distances.min(axis=1)
    return Clearance(distance, scene.names[pair, 0], scene.names[pair, 1])


def _box_pose(box: Box, base: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and centre (3,) of a box in the frame of TCP positions."""
    R, centre = _rotation(box.rotation), np.array(box.centre)
    return (base[:3, :3] @ R, base[:3, :3] @ centre + base[:3, 3]) if box.in_base else (R, centre)


def _rotation(angles: Vector3) -> Array:
    """(3, 3), Rx Ry Rz of three angles (rad)."""
    R = np.eye(3)
    for axis, angle in enumerate(angles):
        R = R @ rotation_about(axis, angle)
    return R


def _carrier(capsule: Capsule) -> int:
    """Number of the joint that moves a capsule; 0 for what stands around the arm."""
    return max(capsule.frame, 0)


def _motion_bound(chain: Chain, home: Array, still: int, capsule: Capsule) -> Array:
    """(n,), m/rad: the largest distance of the capsule's axis from each joint's axis, over all poses.

    Joints up to frame number `still` move both bodies alike and have the bound zero. The distance from one joint to the
    next is the same in every pose, and the capsule is never further out than those distances together. What follows a
    joint at a ratio adds its own distance times that.
    """
    count = len(chain.turning_slots)
    last = min(capsule.frame, count)
    ends = home[capsule.frame, :3, :3] @ np.array([capsule.start, capsule.end]).T + home[capsule.frame, :3, 3:]
    out, reach = np.zeros(count), 0.0
    for joint in range(last, still, -1):
        before = home[joint - 1]
        points = before[:3, :3].T @ (ends - before[:3, 3:])
        # distance from this joint's axis now, plus how far everything beyond can swing out at most
        out[joint - 1] = np.hypot(points[0], points[1]).max() + reach
        reach += np.linalg.norm(points, axis=0).max()
        ends = before[:3, 3:]
    return np.asarray(out @ np.abs(chain.turns))
