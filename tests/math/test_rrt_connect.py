"""Ways round: free by another measure, within limits, the same for the same seed; and why there is none."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.collision_shapes import Box
from lrm_math.arrays import Array
from lrm_math.collision.rrt_connect import NoPath, Path, plan, stream
from lrm_math.collision.scene import Scene, clearance
from lrm_math.collision.straight_move import check_move
from lrm_math.errors import LrmError
from tests.math.test_chain import link_matrices
from tests.math.test_collision import sampled_distance

START, GOAL = np.radians([-60.0, 40, 0, 0, 0, 0]), np.radians([60.0, 40, 0, 0, 0, 0])


@pytest.fixture(params=["lab", "rover"])
def blocked(request: pytest.FixtureRequest) -> Arm:
    """A shipped arm with a post where its tool stands half way from START to GOAL."""
    arm: Arm = request.getfixturevalue(request.param)
    x, y, z = link_matrices(arm, 0.5 * (START + GOAL))[-1][:3, 3].tolist()
    post = Box("post", (x, y, z), (0.05, 0.05, 0.15))
    return replace(arm, shapes=replace(arm.shapes, boxes=(*arm.shapes.boxes, post)))


def found(arm: Arm, start: Array, goal: Array, seed: int = 0, **more: object) -> Path:
    way = plan(Scene.of(arm), start, goal, np.random.default_rng(seed), **more)  # type: ignore[arg-type]
    assert isinstance(way, Path), str(way)
    return way


def assert_good(arm: Arm, way: Path, start: Array, goal: Array, margin: float) -> None:
    """From start to goal, within limits, every pair apart at every step."""
    np.testing.assert_array_equal(way.waypoints[[0, -1]], [start, goal])
    assert (way.waypoints >= [joint.lower - 1e-9 for joint in arm.joints]).all()
    assert (way.waypoints <= [joint.upper + 1e-9 for joint in arm.joints]).all()
    assert clearance(Scene.of(arm), stream(way, 1e-3)).distance.min() >= margin


def test_the_straight_way_is_refused_and_a_way_round_is_found(blocked: Arm) -> None:
    scene = Scene.of(blocked)
    straight = check_move(scene, START, GOAL)
    assert not straight.free
    assert straight.second == "post"
    way = found(blocked, START, GOAL)
    assert len(way.waypoints) > 2
    assert_good(blocked, way, START, GOAL, blocked.shapes.margin)
    assert way.length < 3 * np.linalg.norm(GOAL - START)


def test_the_way_keeps_clear_of_the_post_by_plain_matrices_and_samples(blocked: Arm) -> None:
    """Nothing of the code under test but the path itself: link matrices and points on the capsules' axes."""
    way = found(blocked, START, GOAL)
    moving = [c.name for c in blocked.shapes.capsules if c.frame > 3]
    for q in stream(way, 0.04):
        for name in moving:
            assert sampled_distance(blocked, q, name, "post", 30) >= blocked.shapes.margin


def test_every_piece_passes_the_check_that_the_ramp_makes_again(blocked: Arm) -> None:
    scene, way = Scene.of(blocked), found(blocked, START, GOAL)
    targets = stream(way, 0.2)
    for a, b in pairwise(targets):
        assert check_move(scene, a, b).free


def test_the_same_seed_gives_the_same_way(blocked: Arm) -> None:
    first, again, other = (found(blocked, START, GOAL, seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first.waypoints, again.waypoints)
    assert first.samples == again.samples
    assert first.waypoints.shape != other.waypoints.shape or (first.waypoints != other.waypoints).any()


@settings(max_examples=12)
@given(st.integers(0, 10_000), st.sampled_from(["lab", "rover"]))
def test_any_two_free_poses_of_the_shipped_arms(lab: Arm, rover: Arm, seed: int, name: str) -> None:
    arm = {"lab": lab, "rover": rover}[name]
    scene = Scene.of(arm)
    rng = np.random.default_rng(seed)
    q = rng.uniform(scene.limits[0], scene.limits[1], (50, 6))
    start, goal = q[clearance(scene, q).distance > arm.shapes.margin + 0.002][:2]
    assert_good(arm, found(arm, start, goal, seed), start, goal, arm.shapes.margin)


def test_a_free_straight_way_is_taken(lab: Arm) -> None:
    goal = np.radians([30.0, 20, 10, 0, 0, 0])
    way = found(lab, np.zeros(6), goal)
    np.testing.assert_array_equal(way.waypoints, [np.zeros(6), goal])
    assert way.samples == 0
    np.testing.assert_array_equal(found(lab, goal, goal).waypoints[[0, -1]], [goal, goal])


def test_narrower_limits_are_kept(lab: Arm) -> None:
    x, y, z = link_matrices(lab, 0.5 * (START + GOAL))[-1][:3, 3].tolist()
    post = Box("post", (x, y, z), (0.05, 0.05, 0.05))
    arm = replace(lab, shapes=replace(lab.shapes, boxes=(*lab.shapes.boxes, post)))
    limits = np.array([[-1.1, -0.2, -0.3, -1.0, -0.1, -0.5], [1.1, 0.8, 0.3, 1.0, 0.1, 0.5]])
    way = found(arm, START, GOAL, limits=limits)
    assert (way.waypoints >= limits[0]).all()
    assert (way.waypoints <= limits[1]).all()


# none


def test_start_or_goal_in_collision(blocked: Arm) -> None:
    inside = 0.5 * (START + GOAL)
    for ends, why in (((START, inside), "goal in collision"), ((inside, GOAL), "start in collision")):
        way = plan(Scene.of(blocked), *ends, np.random.default_rng(0))
        assert isinstance(way, NoPath)
        assert way.why == why
        assert way.closest is not None
        assert "post" in (way.closest.first, way.closest.second)
        assert way.closest.distance < blocked.shapes.margin
        assert "post" in str(way)
        assert "30.0 mm" in str(way)


def test_start_or_goal_beyond_a_limit(lab: Arm) -> None:
    beyond = np.array([0.0, 0, 0, 1.8, 0, 0])
    for ends, why in (((np.zeros(6), beyond), "goal outside limits"), ((beyond, np.zeros(6)), "start outside limits")):
        way = plan(Scene.of(lab), *ends, np.random.default_rng(0))
        assert isinstance(way, NoPath)
        assert (way.why, way.joint) == (why, 4)
        assert "joint 4" in str(way)


def test_a_goal_behind_a_wall_is_not_found_after_so_many_samples(blocked: Arm) -> None:
    """Only joint 1 may turn, and the post stands in its way."""
    limits = np.array([START - 1e-3, GOAL + 1e-3])
    way = plan(Scene.of(blocked), START, GOAL, np.random.default_rng(0), limits=limits, samples=25)
    assert isinstance(way, NoPath)
    assert (way.why, way.samples) == ("not found", 25)
    assert way.closest is not None
    assert way.closest.second == "post"
    assert "25 samples" in str(way)


def test_questions_that_make_no_sense(lab: Arm) -> None:
    scene, rng = Scene.of(lab), np.random.default_rng(0)
    for start, goal, more in (
        (np.zeros(5), GOAL, {}),
        (START, np.full(6, np.nan), {}),
        (START, GOAL, {"limits": np.zeros(6)}),
        (START, GOAL, {"limits": [[1.0] * 6, [-1.0] * 6]}),
        (START, GOAL, {"margin": -1.0}),
    ):
        with pytest.raises(LrmError):
            plan(scene, start, goal, rng, **more)  # type: ignore[arg-type]


# to the ramp


@given(st.integers(0, 1000), st.floats(0.002, 0.5))
def test_targets_lie_on_the_way_and_close_together(seed: int, step: float) -> None:
    corners = np.random.default_rng(seed).uniform(-1.7, 1.7, (4, 6))
    way = Path(corners, 0)
    targets = stream(way, step)
    assert np.abs(np.diff(targets, axis=0)).max() <= step + 1e-12
    np.testing.assert_array_equal(targets[[0, -1]], corners[[0, -1]])
    assert np.linalg.norm(np.diff(targets, axis=0), axis=1).sum() == pytest.approx(way.length)
    for corner in corners:
        assert np.abs(targets - corner).max(axis=1).min() < 1e-12


@given(st.integers(0, 1000))
def test_a_ramp_strays_from_the_line_by_a_quarter_of_a_step_at_most(seed: int) -> None:
    """All joints at one speed, each by itself, as the thesis's ramp moves them (section 5.4)."""
    corners = np.random.default_rng(seed).uniform(-1.7, 1.7, (2, 6))
    a, b = stream(Path(corners, 0), 0.05)[:2]
    longest = np.abs(b - a).max()
    for share in np.linspace(0.0, 1.0, 101):
        ramp = a + np.sign(b - a) * np.minimum(np.abs(b - a), share * longest)
        line = a + share * (b - a)
        assert np.abs(ramp - line).max() <= 0.05 / 4 + 1e-12
