"""The collision guard's law: no requests bring two bodies nearer than the margin, or than when the arm was armed.

Read from the commanded angles of every tick, never from replies.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lrm_math.collision.scene import Scene
from lrm_math.collision.straight_move import RESOLUTION
from lrm_math.errors import LrmError
from lrmd.control.state_machine import Mode
from lrmd.ik.planner import NoPlan, Planner
from lrmd.messages.control import JogRequest, MoveRequest
from lrmd.safety.collision_guard import ClearanceViolation, CollisionGuard
from tests.support.daemon.guarded_sequence import JOINTS, MARGIN, GuardedSequence, cluttered_arm, configured, soft_model
from tests.support.sweep import examples, seeds, soak

pytestmark = pytest.mark.long

SEQUENCES, PER_TEST = len(seeds(8, 200)), 25


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, SEQUENCES, PER_TEST))
def test_no_sequence_of_requests_brings_bodies_nearer_than_the_margin_or_than_at_arming(first: int) -> None:
    """Moves of any length, jogs at any rate and renewal, redirections, holds, and models deployed in between."""
    for seed in range(first, min(first + PER_TEST, SEQUENCES)):
        result = GuardedSequence(seed).run()
        assert result.accepted > 0
        assert result.kept, (seed, result)


class Approach(GuardedSequence):
    """A rigid arm that is armed where its smallest separation (m) lies between two values."""

    def __init__(self, low: float, high: float) -> None:
        self.low, self.high = low, high
        for seed in range(100):
            super().__init__(seed)
            self.sim.core.adopt_guard(CollisionGuard(self.scene, None), self.sim.now)
            if self.poses().size:
                break
        self.run(0)
        self.least_at_arming = float(self.separations(self.commanded()[None])[0])

    def poses(self):
        some = np.random.default_rng(0).uniform(-1.5, 1.5, (400, JOINTS))
        apart = self.separations(some)
        return some[(apart > self.low) & (apart < self.high)]

    def start(self):
        return self.poses()[0]

    def least(self) -> float:
        """The smallest separation (m) in any tick since it was armed."""
        return float(self.separations(np.unique(np.array(self.visited), axis=0)).min())


@pytest.mark.parametrize("rate", [0.28, *soak(0.05)])
def test_a_jog_that_is_renewed_without_end_stops_before_the_margin(rate: float) -> None:
    arm = Approach(MARGIN + 5e-3, MARGIN + 15e-3)
    for _ in range(60):
        direction = arm.inward()
        rates = arm.named(rate * direction / np.abs(direction).max())
        for _ in range(4):
            arm.request(JogRequest(lease=arm.token, rate_rad_per_s=rates))
            arm.tick(15)
    assert arm.least() >= MARGIN
    assert arm.least() < arm.least_at_arming - 2e-3, "it did approach"
    arm.tick(100)
    before = arm.commanded()
    arm.request(JogRequest(lease=arm.token, rate_rad_per_s=arm.named(0.28 * arm.inward())))
    arm.tick(1)
    assert np.array_equal(arm.commanded(), before), "no step of a jog that comes nearer"


def test_short_moves_get_no_nearer_than_one_long_one() -> None:
    arm = Approach(MARGIN + 2e-3, MARGIN + 15e-3)
    for _ in range(66):
        arm.request_move(arm.commanded() + 2e-3 * arm.inward())
        arm.tick(20)
    assert arm.least() >= MARGIN


def test_an_arm_within_the_margin_comes_no_nearer_and_may_leave() -> None:
    arm = Approach(2e-3, MARGIN - 2e-3)
    for _ in range(30):
        arm.request_move(arm.commanded() + 5e-3 * arm.inward())
        arm.tick(20)
    assert arm.least() >= arm.least_at_arming - 1e-9
    for _ in range(60):
        arm.request_move(arm.commanded() - 2e-2 * arm.inward())
        arm.tick(30)
    assert float(arm.separations(arm.commanded()[None])[0]) >= MARGIN


def test_an_arm_in_overlap_may_leave_and_goes_no_deeper() -> None:
    arm = Approach(-8e-3, -2e-3)
    arm.request_move(arm.commanded() + 1e-2 * arm.inward())
    arm.tick(30)
    assert arm.least() >= arm.least_at_arming - 1e-9
    assert arm.refused == 1
    for _ in range(80):
        arm.request_move(arm.commanded() - 2e-2 * arm.inward())
        arm.tick(30)
    assert float(arm.separations(arm.commanded()[None])[0]) > 0.0
    assert arm.accepted > 1


def test_a_new_model_stops_a_motion_whose_rest_it_does_not_allow() -> None:
    arm = Approach(MARGIN + 5e-3, MARGIN + 40e-3)
    free = next(q for q in np.random.default_rng(1).uniform(-1.5, 1.5, (500, JOINTS)) if allowed(arm, q))
    arm.request_move(free)
    arm.tick(20)
    assert arm.sim.core.mode is Mode.MOVING

    class Refusing(CollisionGuard):
        def __call__(self, *_) -> None:
            raise LrmError("nothing is allowed")

    arm.sim.core.adopt_guard(Refusing(arm.scene, None), arm.sim.now)
    arm.tick(10)
    assert arm.sim.core.mode is Mode.HOLDING
    assert "motion_stopped" in [event.code for event in arm.sim.core.events]
    there = arm.commanded()
    arm.tick(50)
    assert np.array_equal(arm.commanded(), there)


def allowed(arm: GuardedSequence, q) -> bool:
    try:
        CollisionGuard(arm.scene, None)([arm.commanded(), q], 0.0)
    except ClearanceViolation:
        return False
    return True


def test_a_motion_begins_exactly_where_it_was_checked_from() -> None:
    """Redirected while it moves, whatever the ramp has done since its last report."""
    arm = Approach(MARGIN + 30e-3, MARGIN + 90e-3)
    checked = []
    guard = arm.sim.core.motion_check.guard
    arm.sim.core.motion_check.guard = lambda path, *rest: (checked.append(path), guard(path, *rest))
    rng = np.random.default_rng(3)
    for _ in range(40):
        checked.clear()
        arm.visited.clear()
        arm.sim.settle()
        accepted = arm.accepted
        arm.request_move(arm.commanded() + rng.uniform(-0.1, 0.1, JOINTS))
        arm.tick(int(rng.integers(14, 30)))
        if arm.accepted > accepted and checked:
            nearest = np.abs(np.array(arm.visited) - np.array(checked[0][0])).max(axis=1).min()
            assert nearest < 1e-9, "it passes the pose from which its way was checked"
    assert arm.accepted > 20


@examples(5, 60)
@example(352, True)
@example(9668, False)
@given(st.integers(0, 10_000), st.booleans())
def test_a_way_out_is_offered_if_one_exists(seed: int, soft: bool) -> None:
    """Arms within the margin or in overlap: where a straight way out is allowed, the planner has a path, too.

    The path has corners where a servo's table has: of a move that leaves almost along the obstacle, the guard may allow
    the whole and refuse the part up to the first corner, as seed 9668 has it.
    """
    rng, arm = np.random.default_rng(seed), cluttered_arm(seed)
    guard = CollisionGuard(Scene.of(arm), soft_model(arm, rng) if soft else None)
    poses = rng.uniform(-1.5, 1.5, (100, JOINTS))
    apart = guard.separation(poses, 0.0)
    for start in poses[(apart < MARGIN) & (apart > -0.1)][:2]:
        ends = [q for q in poses[apart > MARGIN + 2 * RESOLUTION] if guard.check(np.array([start, q]), 0.0)[0].free]
        if not ends:
            continue
        planner = Planner(configured(arm), guard, 0.0)
        path = planner.find(start.tolist(), [ends[0].tolist()], seed, lambda: None)
        assert not isinstance(path, NoPlan), path
        guard(path, 0.0)
        way = planner.way_out(start.tolist(), rng, lambda: None)
        assert guard.separation(np.array(way[-1:]), 0.0)[0] >= MARGIN
        guard(way, 0.0)


def test_a_move_of_many_waypoints_is_checked_leg_by_leg() -> None:
    arm = Approach(MARGIN + 5e-3, MARGIN + 40e-3)
    start = arm.commanded()
    far = next(q for q in np.random.default_rng(1).uniform(-1.5, 1.5, (500, JOINTS)) if not allowed(arm, q))
    request = MoveRequest(lease=arm.token, waypoints=[arm.named(start + 1e-4), arm.named(far)])
    with pytest.raises(LrmError, match="waypoint 2") as refused:
        arm.sim.core.handle(request, arm.sim.now)
    assert refused.value.code == "collision"
    assert arm.sim.core.mode is Mode.ARMED
