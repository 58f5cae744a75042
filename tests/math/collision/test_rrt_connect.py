"""RRT-Connect: paths are free by an independent measure, within limits, reproducible; failures give the reason."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.collision_shapes import Box
from lrm_math.arrays import Array
from lrm_math.collision.rrt_connect import NoPath, plan
from lrm_math.collision.scene import Scene, clearance
from lrm_math.errors import LrmError
from tests.math.collision.test_collision import check_move, sampled_distance
from tests.support.link_matrices import link_matrices
from tests.support.sweep import examples, soak

START, GOAL = np.radians([-60.0, 40, 0, 0, 0, 0]), np.radians([60.0, 40, 0, 0, 0, 0])


@pytest.fixture(params=["rover", *soak("lab")])
def blocked(request: pytest.FixtureRequest) -> Arm:
    """A shipped arm with a post at the tool's position half way from START to GOAL."""
    arm: Arm = request.getfixturevalue(request.param)
    x, y, z = link_matrices(arm, 0.5 * (START + GOAL))[-1][:3, 3].tolist()
    post = Box("post", (x, y, z), (0.05, 0.05, 0.15))
    return replace(arm, shapes=replace(arm.shapes, boxes=(*arm.shapes.boxes, post)))


def planned(arm: Arm, start: Array, goal: Array, seed: int = 0, samples: int = 2000) -> Array | NoPath:
    """A path of the rigid arm."""
    scene = Scene.of(arm)
    return plan(scene, start, goal, np.random.default_rng(seed), scene.margin, samples, partial(check_move, scene))


def found(arm: Arm, start: Array, goal: Array, seed: int = 0) -> Array:
    path = planned(arm, start, goal, seed)
    assert not isinstance(path, NoPath), str(path)
    return path


def within(arm: Arm, limits: Array) -> Arm:
    """The arm with other joint limits (2, n), rad."""
    joints = (replace(j, lower=low, upper=high) for j, low, high in zip(arm.joints, *limits, strict=True))
    return replace(arm, joints=tuple(joints))


def length(path: Array) -> float:
    """rad, the sum of the moves of a path (M, n)."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def interpolate_path(path: Array, step: float) -> Array:
    """Targets (K, n) in rad along a path for a ramp, no joint further than `step` (rad) from one to the next.

    Where a ramp moves all joints at one speed, each by itself, those with less to travel arrive early: it deviates from
    the straight line by up to a quarter of the step in each joint.
    """
    targets = [path[:1]]
    for before, after in pairwise(path):
        count = max(1, int(np.ceil(np.abs(after - before).max() / step)))
        targets.append(np.linspace(before, after, count + 1)[1:])
    return np.concatenate(targets)


def assert_good(arm: Arm, path: Array, start: Array, goal: Array, margin: float) -> None:
    """From start to goal, within limits, every pair apart at every step."""
    np.testing.assert_array_equal(path[[0, -1]], [start, goal])
    assert (path >= [joint.lower - 1e-9 for joint in arm.joints]).all()
    assert (path <= [joint.upper + 1e-9 for joint in arm.joints]).all()
    assert clearance(Scene.of(arm), interpolate_path(path, 1e-3)).distance.min() >= margin


@pytest.mark.slow
def test_a_path_is_found_where_the_straight_move_is_refused(blocked: Arm) -> None:
    scene = Scene.of(blocked)
    straight = check_move(scene, START, GOAL)
    assert not straight.free
    assert straight.second == "post"
    path = found(blocked, START, GOAL)
    assert len(path) > 2
    assert_good(blocked, path, START, GOAL, blocked.shapes.margin)
    assert length(path) < 3 * np.linalg.norm(GOAL - START)


@pytest.mark.slow
def test_the_path_is_clear_of_the_post_by_plain_matrices_and_samples(blocked: Arm) -> None:
    """Independent of the code under test: link matrices and points on the capsules' axes."""
    path = found(blocked, START, GOAL)
    moving = [c.name for c in blocked.shapes.capsules if c.frame > 3]
    for q in interpolate_path(path, 0.04):
        for name in moving:
            assert sampled_distance(blocked, q, name, "post", 30) >= blocked.shapes.margin


@pytest.mark.slow
def test_every_piece_passes_the_check_that_the_ramp_makes_again(blocked: Arm) -> None:
    scene, path = Scene.of(blocked), found(blocked, START, GOAL)
    targets = interpolate_path(path, 0.2)
    for a, b in pairwise(targets):
        assert check_move(scene, a, b).free


@pytest.mark.slow
def test_the_same_seed_gives_the_same_path(blocked: Arm) -> None:
    first, again, other = (found(blocked, START, GOAL, seed) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.slow
@examples(6, 12)
@given(st.integers(0, 10_000), st.sampled_from(["lab", "rover"]))
def test_any_two_free_poses_of_the_shipped_arms(lab: Arm, rover: Arm, seed: int, name: str) -> None:
    arm = {"lab": lab, "rover": rover}[name]
    scene = Scene.of(arm)
    rng = np.random.default_rng(seed)
    q = rng.uniform(scene.limits[0], scene.limits[1], (50, 6))
    start, goal = q[clearance(scene, q).distance > arm.shapes.margin + 0.002][:2]
    assert_good(arm, found(arm, start, goal, seed), start, goal, arm.shapes.margin)


def test_a_free_straight_move_is_returned(lab: Arm) -> None:
    goal = np.radians([30.0, 20, 10, 0, 0, 0])
    path = found(lab, np.zeros(6), goal)
    np.testing.assert_array_equal(path, [np.zeros(6), goal])
    np.testing.assert_array_equal(found(lab, goal, goal)[[0, -1]], [goal, goal])


@pytest.mark.slow
def test_narrower_limits_are_kept(lab: Arm) -> None:
    x, y, z = link_matrices(lab, 0.5 * (START + GOAL))[-1][:3, 3].tolist()
    post = Box("post", (x, y, z), (0.05, 0.05, 0.05))
    arm = replace(lab, shapes=replace(lab.shapes, boxes=(*lab.shapes.boxes, post)))
    limits = np.array([[-1.1, -0.2, -0.3, -1.0, -0.1, -0.5], [1.1, 0.8, 0.3, 1.0, 0.1, 0.5]])
    path = found(within(arm, limits), START, GOAL)
    assert (path >= limits[0]).all()
    assert (path <= limits[1]).all()


# none


def test_start_or_goal_in_collision(blocked: Arm) -> None:
    inside = 0.5 * (START + GOAL)
    for ends, why in (((START, inside), "goal in collision"), ((inside, GOAL), "start in collision")):
        path = planned(blocked, *ends)
        assert isinstance(path, NoPath)
        assert path.why == why
        assert "post" in (path.closest.first, path.closest.second)
        assert path.closest.distance < blocked.shapes.margin
        assert "post" in str(path)
        assert "30.0 mm" in str(path)


def test_start_or_goal_beyond_a_limit(lab: Arm) -> None:
    beyond = np.array([0.0, 0, 0, 1.8, 0, 0])
    for ends, why in (((np.zeros(6), beyond), "goal outside limits"), ((beyond, np.zeros(6)), "start outside limits")):
        path = planned(lab, *ends)
        assert isinstance(path, NoPath)
        assert (path.why, path.joint) == (why, 4)
        assert "joint 4" in str(path)


@pytest.mark.long
def test_a_goal_behind_a_wall_is_not_found_after_so_many_samples(blocked: Arm) -> None:
    """Only joint 1 may turn, and the post blocks it."""
    limits = np.array([START - 1e-3, GOAL + 1e-3])
    path = planned(within(blocked, limits), START, GOAL, samples=25)
    assert isinstance(path, NoPath)
    assert (path.why, path.samples) == ("not found", 25)
    assert path.closest.second == "post"
    assert "25 samples" in str(path)


def test_invalid_arguments(lab: Arm) -> None:
    for start, goal in ((np.zeros(5), GOAL), (START, np.full(6, np.nan))):
        with pytest.raises(LrmError):
            planned(lab, start, goal)


# to the ramp


@given(st.integers(0, 1000), st.floats(0.002, 0.5))
def test_interpolated_targets_lie_on_the_path_and_close_together(seed: int, step: float) -> None:
    corners = np.random.default_rng(seed).uniform(-1.7, 1.7, (4, 6))
    targets = interpolate_path(corners, step)
    assert np.abs(np.diff(targets, axis=0)).max() <= step + 1e-12
    np.testing.assert_array_equal(targets[[0, -1]], corners[[0, -1]])
    assert length(targets) == pytest.approx(length(corners))
    for corner in corners:
        assert np.abs(targets - corner).max(axis=1).min() < 1e-12


@given(st.integers(0, 1000))
def test_a_ramp_deviates_from_the_line_by_a_quarter_of_a_step_at_most(seed: int) -> None:
    """All joints at one speed, each by itself, as the thesis's ramp moves them (section 5.4)."""
    corners = np.random.default_rng(seed).uniform(-1.7, 1.7, (2, 6))
    a, b = interpolate_path(corners, 0.05)[:2]
    longest = np.abs(b - a).max()
    for share in np.linspace(0.0, 1.0, 101):
        ramp = a + np.sign(b - a) * np.minimum(np.abs(b - a), share * longest)
        line = a + share * (b - a)
        assert np.abs(ramp - line).max() <= 0.05 / 4 + 1e-12
