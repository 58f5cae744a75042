"""The time of a campaign that is stated before it begins is the time that it takes on simulated servos."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lrm_ident.measuring.campaign.duration import pose_durations
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import PoseTiming, held, rest_at
from lrm_ident.measuring.campaign.servo_arm import SPEED
from lrm_ident.measuring.tracker.frames import TargetNumbers, TargetPose, TrackerFrame
from tests.ident.measuring.campaign.test_servo_arm import FakeClock, FakeRobot, driven

NUMBERS = TargetNumbers(1, None)


class PromptTracker:
    """Sees the tip at once; its frames last as long as they are asked for."""

    def __init__(self, clock: FakeClock) -> None:
        self.clock = clock

    def frames(self, seconds: float) -> Sequence[TrackerFrame]:
        self.clock.sleep(seconds)
        return [TrackerFrame(1, self.clock.t, {1: TargetPose(np.zeros(3), np.eye(3))})]


def taken(poses: Sequence[PlannedPose], timing: PoseTiming) -> float:
    """Time (s) of the poses after the first one, at which the arm stands."""
    clock = FakeClock()
    arm = driven(FakeRobot(), clock)
    arm.go(poses[0])
    began = clock.t
    for pose in poses[1:]:
        begin = clock.now()
        arm.go(pose)
        rest_at(PromptTracker(clock), NUMBERS, clock, held(timing, pose), begin)
    return clock.t - began


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 2.0, 15.0]), st.sampled_from([0.0, 8.0]))
def test_it_is_the_time_on_simulated_servos(seed: int, pause: float, hold: float) -> None:
    rng = np.random.default_rng(seed)
    poses = [
        PlannedPose(k, tuple(rng.uniform(-0.8, 0.8, 5)), 0.0, tuple(rng.choice([-1, 0, 1], 5)), k, hold * (k % 2))
        for k in range(12)
    ]
    timing = PoseTiming(pause, 0.5, 1.0)
    stated = float(pose_durations(poses, timing, (SPEED,) * 5)[1:].sum())
    assert stated == pytest.approx(taken(poses, timing), rel=0.03)


def test_far_poses_take_longer_than_the_pause() -> None:
    """Two and a half radians at half a radian per second, a rest of 0.5 s and 1 s of frames."""
    poses = [PlannedPose(k, (angle, 0.0), 0.0, (), k) for k, angle in enumerate((-1.25, 1.25))]
    near, far = pose_durations(poses, PoseTiming(2.0, 0.5, 1.0), (0.5, 5.0))
    assert (near, far) == pytest.approx((2.0, 6.7))
