"""Distances, clearance and straight moves: against sampled points, another library, and the laws of rigid bodies."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from lrm_ident.data.measurements import Measurements
from lrm_math.arm.arm import Arm, Placement
from lrm_math.arm.arm_file import read_arm
from lrm_math.arm.collision_shapes import Box, Capsule, HeightField, Shapes
from lrm_math.arrays import Array
from lrm_math.collision.distance import depth_in_box, segment_to_box, segment_to_segment
from lrm_math.collision.scene import Scene, clearance, clearance_of
from lrm_math.collision.straight_move import RESOLUTION, ArmBodies, MotionClearance, check_path, rigid_bodies
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, LrmError
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.conftest import ROOT
from tests.support.link_matrices import link_matrices, turn
from tests.support.random_arms import random_arm, with_followers
from tests.support.sweep import examples

coordinates = st.floats(-2.0, 2.0, allow_subnormal=False).map(lambda x: round(x, 4))
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)
edges = st.tuples(*[st.floats(0.01, 1.5)] * 3).map(np.array)
seeds = st.integers(0, 10_000)


def along(a: Array, b: Array, count: int) -> Array:
    """Points of a segment, ends included."""
    return np.asarray(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a))


def rotation(rng: np.random.Generator) -> Array:
    """A random rotation matrix (3, 3)."""
    return np.asarray((turn(0, rng.uniform(-3, 3)) @ turn(1, rng.uniform(-3, 3)) @ turn(2, rng.uniform(-3, 3)))[:3, :3])


def angles_of(R: Array) -> tuple[float, float, float]:
    """alpha, beta, gamma of R = Rx Ry Rz."""
    return (math.atan2(-R[1, 2], R[2, 2]), math.asin(float(np.clip(R[0, 2], -1, 1))), math.atan2(-R[0, 1], R[0, 0]))


def shaped_arm(seed: int, joints: int) -> Arm:
    """A random arm with three capsules per link near it, and boxes around it in both frames."""
    rng = np.random.default_rng(seed)

    def near() -> tuple[float, float, float]:
        x, y, z = rng.normal(0, 0.06, 3).tolist()
        return x, y, z

    capsules = tuple(
        Capsule(f"capsule {frame}{letter}", frame, near(), near(), float(rng.uniform(0.005, 0.02)))
        for frame in range(joints + 2)
        for letter in "ab"
    )
    boxes = tuple(
        Box(
            f"box {i}",
            tuple(rng.normal(0, 0.4, 3).tolist()),
            tuple(rng.uniform(0.02, 0.4, 3).tolist()),
            tuple(rng.uniform(-1.5, 1.5, 3).tolist()),
            in_base=bool(i % 2),
        )
        for i in range(4)
    )
    return replace(random_arm(seed, joints), shapes=Shapes(capsules, boxes, margin=0.01))


shaped_arms = st.builds(shaped_arm, seeds, st.integers(2, 8))
shaped_arms |= st.builds(with_followers, shaped_arms, seeds)


def in_world(arm: Arm, box: Box) -> Array:
    """Frame (4, 4) of a box's centre."""
    T = turn(0, box.rotation[0]) @ turn(1, box.rotation[1]) @ turn(2, box.rotation[2])
    T[:3, 3] = box.centre
    return np.asarray(link_matrices(arm, np.zeros(arm.dof))[0] @ T if box.in_base else T)


def axis_in_world(capsule: Capsule, matrices: list[Array]) -> tuple[Array, Array]:
    """Both ends of a capsule's axis."""
    F = matrices[capsule.frame]
    return F[:3, :3] @ capsule.start + F[:3, 3], F[:3, :3] @ capsule.end + F[:3, 3]


def sampled_distance(arm: Arm, q: Array, first: str, second: str, count: int = 200) -> float:
    """Distance of two bodies by sampled points of their axes, by plain link matrices: never too small."""
    matrices = link_matrices(arm, q)
    capsules = {c.name: c for c in arm.shapes.capsules}
    one = along(*axis_in_world(capsules[first], matrices), count)
    if second in capsules:
        other = along(*axis_in_world(capsules[second], matrices), count)
        gaps = np.linalg.norm(one[:, None] - other, axis=-1)
        return float(gaps.min() - capsules[first].radius - capsules[second].radius)
    (box,) = (b for b in arm.shapes.boxes if b.name == second)
    T = in_world(arm, box)
    seen = (one - T[:3, 3]) @ T[:3, :3]
    outside = np.maximum(np.abs(seen) - 0.5 * np.array(box.size), 0.0)
    return float(np.linalg.norm(outside, axis=1).min() - capsules[first].radius)


# distances


@pytest.mark.slow
@given(points, points, points, points)
def test_segment_distance_against_sampled_points(a: Array, b: Array, c: Array, d: Array) -> None:
    ours = float(segment_to_segment(a, b, c, d))
    sampled = np.linalg.norm(along(a, b, 80)[:, None] - along(c, d, 80), axis=-1).min()
    spacing = (np.linalg.norm(b - a) + np.linalg.norm(d - c)) / 79
    assert sampled - spacing - 1e-12 <= ours <= sampled + 1e-7


@given(points, points, edges)
def test_segment_to_box_against_sampled_points(a: Array, b: Array, half: Array) -> None:
    ours = float(segment_to_box(a, b, half))
    outside = np.maximum(np.abs(along(a, b, 2000)) - half, 0.0)
    sampled = np.linalg.norm(outside, axis=1).min()
    assert sampled - np.linalg.norm(b - a) / 1999 <= ours <= sampled + 1e-12


@given(points, points, edges)
def test_depth_in_a_box_against_sampled_points(a: Array, b: Array, half: Array) -> None:
    ours = float(depth_in_box(a, b, half))
    depth = np.maximum((half - np.abs(along(a, b, 2000))).min(axis=1).max(), 0.0)
    assert depth - 1e-12 <= ours <= depth + np.linalg.norm(b - a) / 1999


@given(points, points, points, points)
def test_segment_distance_is_symmetric(a: Array, b: Array, c: Array, d: Array) -> None:
    ours = segment_to_segment(a, b, c, d)
    for other in (segment_to_segment(c, d, a, b), segment_to_segment(b, a, c, d), segment_to_segment(a, b, d, c)):
        assert float(other) == pytest.approx(float(ours), abs=1e-7)


@given(points, points, points, points, seeds)
def test_segment_distance_is_invariant_to_rigid_motion(a: Array, b: Array, c: Array, d: Array, seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, p = rotation(rng), rng.normal(0, 1, 3)
    moved = segment_to_segment(*(R @ x + p for x in (a, b, c, d)))
    assert float(moved) == pytest.approx(float(segment_to_segment(a, b, c, d)), abs=1e-7)


@given(points, points, points, points, st.floats(0, 1), st.floats(0, 1))
def test_intersecting_segments_have_distance_zero(a: Array, b: Array, c: Array, d: Array, s: float, t: float) -> None:
    meeting = (a + s * (b - a)) - (c + t * (d - c))
    assert float(segment_to_segment(a, b, c + meeting, d + meeting)) == pytest.approx(0.0, abs=1e-7)


@given(edges, seeds, points)
def test_a_segment_through_a_box_has_distance_zero(half: Array, seed: int, b: Array) -> None:
    inside = np.random.default_rng(seed).uniform(-half, half)
    assert float(segment_to_box(inside, b, half)) == pytest.approx(0.0, abs=1e-12)
    assert float(segment_to_box(2 * inside - b, b, half)) == pytest.approx(0.0, abs=1e-9)


@given(points, points, edges)
def test_segments_of_length_zero_are_points(a: Array, c: Array, half: Array) -> None:
    assert float(segment_to_segment(a, a, c, c)) == pytest.approx(float(np.linalg.norm(a - c)), abs=1e-12)
    expected = np.linalg.norm(np.maximum(np.abs(a) - half, 0.0))
    assert float(segment_to_box(a, a, half)) == pytest.approx(float(expected), abs=1e-12)


def test_parallel_segments_by_hand() -> None:
    a, b = np.array([0.0, 0, 0]), np.array([1.0, 0, 0])
    for start, end, expected in (
        ([0.2, 3, 0], [0.7, 3, 0], 3.0),
        ([4.0, 4, 0], [9, 4, 0], 5.0),
        ([1.0, 0, 0], [2, 0, 0], 0.0),
    ):
        assert float(segment_to_segment(a, b, np.array(start), np.array(end))) == pytest.approx(expected, abs=1e-12)


@examples(10, 20)
@given(shaped_arms, seeds)
def test_distances_against_coal(arm: Arm, seed: int) -> None:
    """Distance of every pair that does not overlap, against the collision library of pinocchio."""
    coal: Any = pytest.importorskip("coal", reason="coal is not installed (extra 'bench')")
    scene = Scene.of(arm)
    q = np.random.default_rng(seed).uniform(-2, 2, arm.dof)
    matrices = link_matrices(arm, q)
    solids: dict[str, tuple[object, object]] = {}
    for capsule in arm.shapes.capsules:
        a, b = axis_in_world(capsule, matrices)
        length = float(np.linalg.norm(b - a))
        z = (b - a) / length
        x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(z, x), z])
        solids[capsule.name] = coal.Capsule(capsule.radius, length), coal.Transform3s(R, 0.5 * (a + b))
    for box in arm.shapes.boxes:
        T = in_world(arm, box)
        solids[box.name] = coal.Box(*box.size), coal.Transform3s(T[:3, :3], T[:3, 3])
    for (first, second), ours in zip(scene.names, scene.distances(scene.frames(q[None]))[0], strict=True):
        if ours > 1e-4:
            result = coal.DistanceResult()
            theirs = coal.distance(*solids[first], *solids[second], coal.DistanceRequest(), result)
            assert ours == pytest.approx(theirs, abs=1e-5), (first, second)


# clearance


@pytest.mark.slow
@examples(12, 25)
@given(shaped_arms, seeds)
def test_clearance_is_the_least_distance_of_checked_pairs(arm: Arm, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-2, 2, (2, arm.dof))
    found = clearance(Scene.of(arm), q)
    frame = {c.name: c.frame for c in arm.shapes.capsules} | {b.name: 0 for b in arm.shapes.boxes}
    names = list(frame)
    for pose in range(2):
        sampled = {
            (one, other): sampled_distance(arm, q[pose], one, other, 40)
            for i, one in enumerate(names)
            for other in names[i + 1 :]
            if abs(frame[one] - frame[other]) > 1
        }
        longest = 2 * max(math.dist(c.start, c.end) for c in arm.shapes.capsules) / 39
        least = min(sampled.values())
        assert least - longest <= found.distance[pose] <= least + 1e-9
        said = sampled[str(found.first[pose]), str(found.second[pose])]
        assert said == pytest.approx(float(found.distance[pose]), abs=longest)


@pytest.mark.slow
@given(shaped_arms, seeds)
def test_clearance_is_invariant_to_motion_of_arm_and_obstacles_together(arm: Arm, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2, 2, (3, arm.dof))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation(rng), rng.normal(0, 1, 3)
    base = T @ link_matrices(arm, np.zeros(arm.dof))[0]

    def moved(box: Box) -> Box:
        place = T @ in_world(arm, replace(box, in_base=False))
        at, R = tuple(place[:3, 3].tolist()), place[:3, :3]
        return box if box.in_base else replace(box, centre=at, rotation=angles_of(R))

    elsewhere = replace(
        arm,
        base=Placement(*base[:3, 3].tolist(), *angles_of(base[:3, :3])),
        shapes=replace(arm.shapes, boxes=tuple(moved(box) for box in arm.shapes.boxes)),
    )
    here, there = (Scene.of(a).distances(Scene.of(a).frames(q)) for a in (arm, elsewhere))
    np.testing.assert_allclose(here, there, atol=1e-7)


@pytest.mark.slow
@given(shaped_arms, seeds)
def test_one_pose_equals_the_batch(arm: Arm, seed: int) -> None:
    scene = Scene.of(arm)
    q = np.random.default_rng(seed).uniform(-2, 2, (4, arm.dof))
    together = clearance(scene, q)
    for pose in range(4):
        alone = scene.closest(q[pose])
        assert alone.distance == pytest.approx(float(together.distance[pose]), abs=1e-12)
        assert (alone.first, alone.second) == (together.first[pose], together.second[pose])


def test_overlap_is_negative_and_grows_with_depth(lab: Arm) -> None:
    """A box moved into the round end of link 6 (radius 25 mm), until its face reaches the middle of that end."""
    (link,) = (c for c in lab.shapes.capsules if c.name == "link 6")
    x, y, z = link_matrices(lab, np.zeros(6))[-1][:3, 3].tolist()
    for away, expected in ((0.060, 0.015), (0.044, -0.001), (0.030, -0.015), (0.020, -0.025), (0.0, -0.025)):
        rock = Box("rock", (x + away, y, z), (0.04, 0.04, 0.04))
        found = Scene.of(replace(lab, shapes=Shapes((link,), (rock,)))).closest(np.zeros(6))
        assert found.distance == pytest.approx(expected, abs=1e-9)
        assert (found.first, found.second) == ("link 6", "rock")


@pytest.mark.parametrize("name", ["lab", "rover"])
def test_home_is_free(name: str, request: pytest.FixtureRequest) -> None:
    arm = request.getfixturevalue(name)
    assert Scene.of(arm).closest(np.zeros(6)).distance > arm.shapes.margin


@pytest.mark.parametrize("name", ["lab", "rover"])
def test_each_joint_alone_is_free_over_its_calibrated_range(name: str, request: pytest.FixtureRequest) -> None:
    """Thesis Table 3.1: 100 degrees in both directions, so the links without obstacles must not collide there."""
    arm = request.getfixturevalue(name)
    links = tuple(c for c in arm.shapes.capsules if not c.name.startswith("target"))
    names = {c.name for c in links}
    ignored = tuple(pair for pair in arm.shapes.ignored if names.issuperset(pair))
    scene = Scene.of(replace(arm, shapes=Shapes(links, (), arm.shapes.margin, ignored)))
    for joint in range(arm.dof):
        q = np.zeros((41, arm.dof))
        q[:, joint] = np.linspace(arm.joints[joint].lower, arm.joints[joint].upper, 41)
        assert clearance(scene, q).distance.min() > arm.shapes.margin, f"joint {joint + 1}"


def test_the_measured_poses_are_free(lab: Arm, real: Measurements) -> None:
    """All 393, by more than the margin: no shipped shape is larger than the arm and its rig."""
    found = clearance(Scene.of(lab), real.poses.q)
    assert len(found.distance) == 393
    worst = found.distance.argmin()
    assert found.distance[worst] > lab.shapes.margin, (found.first[worst], found.second[worst])


def test_elastic_deflection_reduces_the_distance_to_the_ground(rover: Arm) -> None:
    """Elastic frames: the distance to the ground falls by the deflection of the lowest body, the gripper."""
    model = model_of(
        rover, effects_at(rover, "compliance"), {f"compliance.joint{i}.k_rad_per_Nm": 0.05 for i in (2, 4)}
    )
    ground = tuple(box for box in rover.shapes.boxes if box.name == "ground")
    fingers = tuple(c for c in rover.shapes.capsules if c.name == "fingers")
    scene = Scene.of(replace(rover, shapes=Shapes(fingers, ground)))
    q = np.radians([[0.0, 45.0, 0.0, 0.0, 0.0, 10.0]])
    equilibrium = solve_equilibrium(model, poses_of(q))
    bent = frames(model.chain, equilibrium.slots, 1)
    rigid = clearance(scene, q).distance[0]
    tips = [F[0, -1] @ np.array([[0, 0, z, 1.0] for z in (-0.045, -0.02)]).T for F in (scene.frames(q), bent)]
    sunk = tips[0][2].min() - tips[1][2].min()
    assert sunk > 0.005
    assert rigid - clearance_of(scene, bent).distance[0] == pytest.approx(sunk, abs=1e-9)


# straight moves


@pytest.mark.slow
@given(shaped_arms, seeds)
def test_distances_change_no_faster_than_the_motion_bound(arm: Arm, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rough = tuple(map(tuple, rng.normal(0.0, 0.2, (9, 7))))
    scene = Scene.of(arm, around=[HeightField("map", (-0.4, -0.5, -0.2), 0.12, rough, (0.1, 0.2, 0.3))])
    q = rng.uniform(-3, 3, (6, arm.dof))
    nudged = q + rng.choice([1e-3, 0.1, 1.0], (6, 1)) * rng.uniform(-1, 1, q.shape) * (rng.random(q.shape) < 0.6)
    change = np.abs(scene.distances(scene.frames(nudged)) - scene.distances(scene.frames(q)))
    assert (change <= np.abs(nudged - q) @ scene.motion_bound.T + 1e-7).all()


def check_move(scene: Scene, q0: ArrayLike, q1: ArrayLike, margin: float | None = None) -> MotionClearance:
    """Whether the rigid arm keeps a margin (m; its own if None) by the distances of its bodies."""
    bodies = ArmBodies(scene, lambda q: scene.distances(scene.frames(q)))
    return check_path(bodies, np.array([scene.pose(q0), scene.pose(q1)]), scene.margin if margin is None else margin)[0]


@pytest.mark.long
@examples(7, 15)
@given(shaped_arms, seeds, st.integers(2, 12), st.sampled_from([0.02, 0.3, 1.5]))
def test_a_path_is_checked_as_its_moves_are_one_by_one(arm: Arm, seed: int, count: int, step: float) -> None:
    scene, rng = Scene.of(arm), np.random.default_rng(seed)
    path = np.cumsum(np.vstack([rng.uniform(-2, 2, arm.dof), rng.uniform(-step, step, (count, arm.dof))]), axis=0)
    keep = np.minimum(scene.margin, scene.separations(scene.frames(path[:1]))[0] - rng.choice([0.0, 0.002]))
    bodies = rigid_bodies(scene)
    alone = [check_path(bodies, np.array(move), keep)[0] for move in pairwise(path)]
    found, move = check_path(bodies, path, keep)
    refused = next((number for number, one in enumerate(alone) if not one.free), None)
    assert found.free == (refused is None)
    if refused is None:
        assert found.distance - found.margin == pytest.approx(min(one.distance - one.margin for one in alone), abs=1e-6)
        return
    assert move == refused
    assert found.proven == pytest.approx(alone[refused].proven, abs=1e-9)
    assert (found.first, found.second) == (alone[refused].first, alone[refused].second)


@pytest.mark.slow
@examples(12, 25)
@given(shaped_arms, seeds, st.sampled_from([0.0, 0.005, 0.03]))
def test_check_move_agrees_with_dense_sampling(arm: Arm, seed: int, margin: float) -> None:
    scene = Scene.of(arm)
    rng = np.random.default_rng(seed)
    q0 = rng.uniform(-2, 2, arm.dof)
    q1 = q0 + rng.uniform(0.05, 1.5) * rng.uniform(-1, 1, arm.dof)
    move = check_move(scene, q0, q1, margin)
    fraction = np.linspace(0.0, 1.0, 2001)
    dense = clearance(scene, q0 + fraction[:, None] * (q1 - q0)).distance
    there = scene.closest(q0 + move.fraction * (q1 - q0))
    assert (there.distance, there.first, there.second) == (pytest.approx(move.distance), move.first, move.second)
    assert (dense[fraction < move.proven] >= margin).all()
    if move.free:
        assert dense.min() >= margin
    else:
        assert move.distance < margin + RESOLUTION
        assert 0.0 <= move.proven <= move.fraction <= 1.0
        assert abs(move.fraction - move.proven) * float((scene.motion_bound @ np.abs(q1 - q0)).max()) <= 2 * RESOLUTION


@pytest.mark.slow
@examples(12, 25)
@given(shaped_arms, seeds, st.floats(-0.02, 0.02))
def test_a_way_that_is_found_free_comes_no_nearer_than_its_start_anywhere(arm: Arm, seed: int, scale: float) -> None:
    """Down to nanometres, from any start, overlaps included; and one that only leaves is found free."""
    scene, rng = Scene.of(arm), np.random.default_rng(seed)
    q0 = rng.uniform(-2, 2, arm.dof)
    bodies = rigid_bodies(scene)
    keep = bodies.separation(q0)
    nudge = 1e-6 * np.eye(arm.dof)
    gradient = (bodies.separations(q0 + nudge).min(axis=1) - bodies.separations(q0 - nudge).min(axis=1)) / 2e-6
    for direction in (rng.uniform(-1, 1, arm.dof), gradient / max(float(np.linalg.norm(gradient)), 1e-9)):
        q1 = q0 + scale * direction
        path = q0 + np.linspace(0.0, 1.0, 1001)[:, None] * (q1 - q0)
        found, _ = check_path(bodies, np.array([q0, q1]), keep)
        least = bodies.separations(path).min()
        if found.free:
            assert least >= keep - 2e-9
        else:
            assert least < keep + 1e-5


@examples(10, 20)
@given(st.floats(-1.2, 1.2), st.floats(0.1, 0.9))
def test_thin_obstacles_are_detected(lab: Arm, where: float, height: float) -> None:
    """An obstacle of 0.1 mm on the path of a thin capsule, which sampling would miss."""
    q = np.array([where, 1.2, 0.0, 0.0, 0.0, 0.0])
    thread = Capsule("thread", 6, (0.0, 0.0, 0.0), (0.0, -0.2, 0.0), 1e-4)
    a, b = axis_in_world(thread, link_matrices(lab, q))
    grain = Box("grain", tuple((a + height * (b - a)).tolist()), (1e-4, 1e-4, 1e-4))
    move = check_move(Scene.of(replace(lab, shapes=Shapes((thread,), (grain,)))), [-1.7, *q[1:]], [1.7, *q[1:]], 0.0)
    assert not move.free
    assert move.fraction == pytest.approx((where + 1.7) / 3.4, abs=0.01)


def test_a_refusal_names_bodies_fraction_and_distance(rover: Arm) -> None:
    q1 = np.radians([0.0, 80.0, 0.0, 60.0, 0.0, 0.0])
    move = check_move(Scene.of(rover), np.zeros(6), q1)
    assert not move.free
    assert 0.0 < move.fraction < 1.0
    for word in (move.first, move.second, f"{move.distance * 1e3:.1f} mm", f"{move.fraction:.1%}", "30.0 mm"):
        assert word in str(move)
    assert check_move(Scene.of(rover), np.zeros(6), move.proven * q1).free


def test_allowed_pairs_may_collide(rover: Arm) -> None:
    q = np.radians([0.0, 80.0, 0.0, 60.0, 0.0, 0.0])
    strict = Scene.of(rover)
    allowed = Scene.of(rover, allow=[("fingers", "ground"), ("ground", "palm"), ("link 6", "ground")])
    assert {strict.closest(q).first, strict.closest(q).second} <= {"fingers", "palm", "link 6", "ground"}
    assert allowed.closest(q).distance > strict.closest(q).distance


# what is refused


BAD: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "unknown frame": ('frame = "joint5"\nfrom_mm', 'frame = "joint9"\nfrom_mm', ("capsule 'link 5'", "joint9")),
    "no radius": ("radius_mm = 30.0", "radius_mm = 0.0", ("capsule 2", "radius_mm", "0.0")),
    "flat box": ("size_mm = [502.0, 430.0, 330.0]", "size_mm = [502.0, 0.0, 330.0]", ("box 1", "0.0")),
    "box on a link": ('name = "stand"\nframe = "base"', 'name = "stand"\nframe = "joint3"', ("box", "frame", "joint3")),
    "same name": ('name = "table"', 'name = "marble"', ("two shapes", "marble")),
    "unknown pair": ('["link 2", "stand"]', '["link 2", "stant"]', ("stant", "stand")),
    "half a pair": ('["link 2", "stand"]', '["link 2"]', ("ignore", "link 2")),
    "negative margin": ("margin_mm = 30.0", "margin_mm = -1.0", ("collision", "margin_mm")),
    "unknown key": ("margin_mm = 30.0", "margin_cm = 3.0", ("collision", "margin_cm", "margin_mm")),
}


@pytest.mark.parametrize("fault", BAD)
def test_bad_shapes_in_a_file_are_one_clear_line(tmp_path: Path, fault: str) -> None:
    old, new, words = BAD[fault]
    text = (ROOT / "config" / "arms" / "lrm-lab.toml").read_text()
    assert old in text
    path = tmp_path / "arm.toml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(FileError) as caught:
        read_arm(path)
    assert "\n" not in str(caught.value)
    for word in (str(path), *words):
        assert word in str(caught.value)


def test_a_scene_needs_shapes(lab: Arm) -> None:
    with pytest.raises(LrmError, match="capsule"):
        Scene.of(replace(lab, shapes=Shapes()))


@pytest.mark.parametrize("q", [[0.0] * 5, [[0.0] * 7], [0.0, 0.0, math.nan, 0.0, 0.0, 0.0]])
def test_invalid_angles(lab: Arm, q: list[float]) -> None:
    scene = Scene.of(lab)
    with pytest.raises(LrmError, match="finite"):
        clearance(scene, q)
    with pytest.raises(LrmError, match="finite"):
        check_move(scene, q if len(q) == 5 else [math.nan] * 6, np.zeros(6))


@pytest.mark.parametrize("margin", [-0.01, math.nan, math.inf])
def test_invalid_margins(lab: Arm, margin: float) -> None:
    with pytest.raises(LrmError, match="margin"):
        Scene.of(lab).margin_or_default(margin)


def test_invalid_frames(lab: Arm) -> None:
    with pytest.raises(LrmError, match="frames"):
        clearance_of(Scene.of(lab), np.zeros((1, 7, 4, 4)))
    with pytest.raises(LrmError, match="finite"):
        clearance_of(Scene.of(lab), np.full((1, 8, 4, 4), math.nan))
