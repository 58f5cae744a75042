"""A campaign's arm through LeRobot, by a stand-in for its robots: slow, watched, in the time that is stated."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lrm_ident.measuring.campaign.duration import pose_durations
from lrm_ident.measuring.campaign.lerobot_robot import MOST_TORQUE, LeRobotServos
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import PoseTiming, Unreachable, held, rest_at
from lrm_ident.measuring.campaign.servo_arm import SPEED, TICK_S, TORQUE, ServoArm
from lrm_ident.measuring.tracker.frames import TargetNumbers, TargetPose, TrackerFrame
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from tests.support.commands import stderr_of
from tests.support.simulated_clock import SimulatedClock

ARM = load_arm("so101")
NAMES = [joint.name for joint in ARM.joints]
ANGLES = st.lists(st.floats(-0.8, 0.8), min_size=5, max_size=5)


@dataclass
class FakeBus:
    """Registers of every motor. `refusals`: how many reads fail before one succeeds."""

    heat: float = 30.0
    torque: int = 1
    refusals: int = 0
    limits: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.motors = {name: SimpleNamespace(model="sts3215") for name in NAMES}
        self.model_ctrl_table: dict[str, Any] = {"sts3215": {"Torque_Limit": (48, 2)}}
        self.model_resolution_table = {"sts3215": 4096}
        self.calibration = {name: SimpleNamespace(range_min=1024, range_max=3071) for name in NAMES}

    def sync_read(self, register: str, motors: list[str]) -> dict[str, float]:
        if self.refusals:
            self.refusals -= 1
            raise ConnectionError("no status\npacket")
        if register == "Torque_Limit":
            return {name: self.limits.get(name, 1000) for name in motors}
        return dict.fromkeys(motors, {"Present_Temperature": self.heat, "Torque_Enable": self.torque}[register])

    def write(self, register: str, motor: str, value: int) -> None:
        assert register == "Torque_Limit"
        self.limits[motor] = value


class FakeRobot:
    """Follows at once, but for a joint that is held."""

    name = "so_follower"

    def __init__(self, names: list[str] = NAMES) -> None:
        self.action_features = {f"{name}.pos": float for name in (*names, "gripper")}
        self.at = dict.fromkeys(self.action_features, 0.0)
        self.bus, self.held, self.sent = FakeBus(), "", list[dict[str, float]]()

    def get_observation(self) -> dict[str, Any]:
        return dict(self.at)

    def send_action(self, action: Mapping[str, float]) -> None:
        assert set(action) == {f"{name}.pos" for name in NAMES}  # the gripper is left alone
        self.sent.append(dict(action))
        self.at |= {key: value for key, value in action.items() if key != self.held}


def driven(robot: FakeRobot, clock: SimulatedClock | None = None) -> ServoArm:
    return ServoArm(LeRobotServos.of(robot, ARM), ARM, clock or SimulatedClock(), lambda _: None)


def pose(q: list[float], approach: int = 0) -> PlannedPose:
    return PlannedPose(1, tuple(q), 0.0, (approach,) * len(q), 1)


@given(st.lists(ANGLES, min_size=1, max_size=4), st.sampled_from([-1, 0, 1]))
def test_it_goes_straight_and_no_faster_than_it_may(goals: list[list[float]], approach: int) -> None:
    robot, clock = FakeRobot(), SimulatedClock()
    arm = driven(robot, clock)
    assert robot.sent == []  # nothing moves until it is asked to
    before = [0.0] * 5
    for goal in goals:
        state = arm.go(pose(goal, approach))
        assert state.q == pytest.approx(goal)
        if approach:
            assert state.direction == (approach,) * 5
    for action in robot.sent:
        now = [math.radians(action[f"{name}.pos"]) for name in NAMES]
        assert max(abs(a - b) for a, b in zip(now, before, strict=True)) <= SPEED * TICK_S + 1e-9
        before = now
    assert robot.bus.limits == dict.fromkeys(NAMES, TORQUE * MOST_TORQUE)


@given(st.lists(st.integers(0, MOST_TORQUE), min_size=5, max_size=5), st.booleans())
def test_a_servo_that_holds_is_given_no_more_torque(limits: list[int], holds: bool) -> None:
    robot = FakeRobot()
    robot.bus.limits, robot.bus.torque = dict(zip(NAMES, limits, strict=True)), int(holds)
    LeRobotServos.of(robot, ARM).bound_torque(0.6)
    bound = round(0.6 * MOST_TORQUE)
    assert [*robot.bus.limits.values()] == [min(limit, bound) if holds else bound for limit in limits]


def test_a_joint_that_is_held_up_ends_it_and_the_arm_holds() -> None:
    robot = FakeRobot()
    robot.held = "elbow_flex.pos"
    with pytest.raises(LrmError, match=r"elbow_flex does not follow: .* The arm holds"):
        driven(robot).go(pose([0.0, 0.0, 1.2, 0.0, 0.0]))
    assert robot.sent[-1] == {f"{name}.pos": pytest.approx(robot.at[f"{name}.pos"]) for name in NAMES}


def test_what_happens_during_a_rest_is_told() -> None:
    robot = FakeRobot()
    arm = driven(robot)
    arm.go(pose([0.1] * 5))
    assert arm.disturbed() == ""
    robot.at["wrist_flex.pos"] += 3.0
    assert arm.disturbed() == "wrist_flex was moved"
    robot.bus.torque = 0
    assert arm.disturbed() == "shoulder_pan has no torque"


def test_a_hot_servo_cools_where_it_bears_little() -> None:
    robot, clock = FakeRobot(), SimulatedClock()
    arm = driven(robot, clock)
    assert arm.too_warm() == ""
    robot.bus.heat = 56.0
    assert arm.too_warm() == "shoulder_pan is 56 °C"
    slept = clock.sleep

    def cooling(seconds: float) -> None:
        slept(seconds)
        robot.bus.heat -= 0.1 * seconds

    clock.sleep = cooling  # type: ignore[method-assign]
    arm.cool(pose([0.0] * 5))
    assert robot.bus.heat <= 45.0


def test_late_answers_are_asked_for_again_and_silence_is_one_line() -> None:
    robot = FakeRobot()
    arm = driven(robot)
    robot.bus.refusals = 3
    assert arm.too_warm() == ""
    robot.bus.refusals = 100
    with pytest.raises(LrmError, match=r"^so_follower does not answer: no status packet$"):
        arm.too_warm()


def test_poses_beyond_the_limits_and_other_robots() -> None:
    with pytest.raises(Unreachable, match="joint 1 would leave its limits"):
        driven(FakeRobot()).go(pose([3.0, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(LrmError, match="has no 'wrist_roll' of so101; it has shoulder_pan"):
        driven(FakeRobot(NAMES[:4]))


def test_without_lerobot_one_line_says_so(tmp_path: Any) -> None:
    poses = tmp_path / "poses.csv"
    poses.write_text("pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n1,0,0,0,0,0\n2,30,0,0,0,0\n")
    words = [
        "measure", poses, "--robot", "lerobot:so101_follower", "--tracker", "dtrack:45991", "-o", tmp_path / "d.csv",
    ]  # fmt: skip
    said = stderr_of(*words)
    assert "LeRobot is not installed here" in said or "missing" in said


NUMBERS = TargetNumbers(1, None)


class PromptTracker:
    """Sees the tip at once; its frames last as long as they are asked for."""

    def __init__(self, clock: SimulatedClock) -> None:
        self.clock = clock

    def frames(self, seconds: float) -> Sequence[TrackerFrame]:
        self.clock.sleep(seconds)
        return [TrackerFrame(1, self.clock.t, {1: TargetPose(np.zeros(3), np.eye(3))})]


def taken(poses: Sequence[PlannedPose], timing: PoseTiming) -> float:
    """Time (s) of the poses after the first one, at which the arm stands."""
    clock = SimulatedClock()
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
