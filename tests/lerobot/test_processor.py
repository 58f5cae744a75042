"""The correction as LeRobot's processor steps does what the calibrated robot does, and nothing beside it."""

from __future__ import annotations

from functools import partial
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples.so101.feetech_servo import FeetechServo
from lerobot_robot_lrm.bounded import FARTHEST, RATE, REVERSAL
from lrm_math.errors import LrmError
from lrm_math.kinematics.motion import Motion
from tests.doors.lerobot_classes import calibrated_robot_class, plug_in, robot_config
from tests.doors.servos_door import MODEL, NAMES
from tests.doors.simulated_follower import SimulatedFollower
from tests.lerobot.test_in_motion import RUBBING
from tests.support.motion_models import write_motion_model
from tests.support.sweep import examples

MEASURED_WITH = """
[provenance]
data = "data.csv"
data_sha256 = ""
poses = 60
tool = ""
date = ""
[provenance.servos.shoulder_pan]
p = 32
"""
WISHES = st.lists(st.lists(st.floats(-45.0, 45.0), min_size=5, max_size=5), min_size=1, max_size=8)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("model") / "model.toml"
    path.write_text(MODEL)
    return str(path)


@pytest.fixture(scope="module")
def motion(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_motion_model(RUBBING, tmp_path_factory.mktemp("motion") / "motion.toml"))


def follower() -> SimulatedFollower:
    robot = SimulatedFollower(NAMES, [FeetechServo(number) for number in range(1, 6)])
    robot.connect()
    return robot


def action_of(degrees: Any, prefix: str = "") -> dict[str, float]:
    return dict(zip((f"{prefix}{name}.pos" for name in NAMES), map(float, degrees), strict=True))


@pytest.mark.long
@pytest.mark.parametrize(("in_motion", "lead"), [(False, False), (True, False), (True, True)])
@examples(12, 25)
@given(wishes=WISHES)
def test_it_sends_and_observes_what_the_calibrated_robot_does(
    model: str, motion: str, in_motion: bool, lead: bool, wishes: list[list[float]]
) -> None:
    deployed = motion if in_motion else ""
    config = robot_config(model, motion=deployed, lead=lead)
    beside, wrapped = follower(), follower()
    robot = calibrated_robot_class()(config, wrapped)
    robot.connect()
    action, observation = plug_in("pipelines").calibrated_processors(beside, model, motion=deployed, lead=lead)
    action.reset()
    for arm in (robot.arm, *(step.arm for step in action.steps)):
        arm.clock = partial(next, count(0.0, 1.0 / 30.0))
    for wish in wishes:
        beside.send_action(action((action_of(wish), beside.get_observation())))
        robot.send_action(action_of(wish))
        assert beside.get_observation() == wrapped.get_observation()
        assert observation(beside.get_observation()) == robot.get_observation()


@pytest.mark.long
@examples(12, 25)
@given(wishes=WISHES)
def test_commands_stay_within_the_bounds_after_any_wish(model: str, wishes: list[list[float]]) -> None:
    step = plug_in("processor").CalibratedAction(model)
    step.reset()
    shift, before, last = step.arm.correction.zero_shift, None, None
    for wish in wishes:
        out = step({"action": action_of(wish), "observation": action_of(np.zeros(5))})["action"]
        command, wished = (np.radians([values[key] for key in step.arm.keys]) for values in (out, action_of(wish)))
        assert np.abs(command - wished - shift).max() <= FARTHEST + 1e-9
        if before is not None and last is not None:
            most = (1.0 + RATE) * np.abs(wished - last).max() + REVERSAL
            assert np.abs(command - before).max() <= most + 1e-9
        before, last = command, wished


def test_reset_forgets_the_motion_and_the_next_action_begins_where_the_arm_is_seen(model: str) -> None:
    step, seen = plug_in("processor").CalibratedAction(model), action_of((5.0, 10.0, -5.0, 0.0, 0.0))
    step({"action": action_of((30.0, 30.0, -30.0, 10.0, 0.0)), "observation": action_of(np.zeros(5))})
    step.reset()
    assert step.arm.motion is None
    wish = action_of((10.0, 12.0, -8.0, 2.0, 1.0))
    out = step({"action": wish, "observation": seen})["action"]
    start = Motion.at(np.radians([seen[key] for key in step.arm.keys]))
    expected = step.arm.correction.command(np.radians([wish[key] for key in step.arm.keys]), start)
    np.testing.assert_allclose([out[key] for key in step.arm.keys], np.degrees(expected), atol=1e-9)


def test_steps_are_made_again_of_their_configuration_and_share_one_arm(model: str) -> None:
    steps = plug_in("processor")
    action = steps.CalibratedAction(model, 50.0, "base", "left_", {"wrist_roll": 150.0})
    again = steps.CalibratedObservation(**action.get_config())
    assert again.get_config() == action.get_config()
    assert again.arm is action.arm
    assert steps.CalibratedObservation(model).arm is not action.arm
    assert action.arm.keys[0] == "left_shoulder_pan.pos"
    assert action.transform_features({"a": 1}) == {"a": 1}


def test_joints_in_percent_of_their_range_are_read_as_such(model: str) -> None:
    steps = plug_in("processor")
    degrees, percent = steps.CalibratedAction(model), steps.CalibratedAction(model, half_range_deg={"elbow_flex": 50.0})
    wish, at = action_of((3.0, 8.0, 20.0, 0.0, 0.0)), action_of(np.zeros(5))
    for step in (degrees, percent):
        step.reset()
    one = degrees({"action": wish, "observation": at})["action"]
    two = percent({"action": {**wish, "elbow_flex.pos": 40.0}, "observation": at})["action"]
    assert two["elbow_flex.pos"] == pytest.approx(2.0 * one["elbow_flex.pos"])
    assert two["shoulder_pan.pos"] == pytest.approx(one["shoulder_pan.pos"])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"half_range_deg": {"elbow": 50.0}}, "half_range_deg: no joint 'elbow'"),
        ({"half_range_deg": {"elbow_flex": 0.0}}, "should be an angle in degrees that 100 is"),
        ({"keep": "wrist"}, "keep wrist; should be base, tool"),
    ],
)
def test_a_bad_configuration_is_one_clear_line(model: str, options: dict[str, Any], said: str) -> None:
    with pytest.raises(LrmError, match=said):
        plug_in("processor").CalibratedAction(model, **options)


def test_the_first_action_needs_an_observation(model: str) -> None:
    step = plug_in("processor").CalibratedAction(model)
    step.reset()
    with pytest.raises(LrmError, match="the first action needs the robot's observation"):
        step({"action": action_of(np.zeros(5)), "observation": None})


def test_a_robot_that_corrects_already_or_is_set_otherwise_is_refused(model: str, tmp_path: Path) -> None:
    make = plug_in("pipelines").calibrated_processors
    config = robot_config(model)
    with pytest.raises(LrmError, match="corrects its commands already"):
        make(calibrated_robot_class()(config, follower()), model)
    away = follower()
    away.is_connected = False
    with pytest.raises(LrmError, match="is not connected"):
        make(away, model)
    other = tmp_path / "model.toml"
    other.write_text(MODEL + MEASURED_WITH)
    robot = follower()
    robot.bus.model_ctrl_table["sts3215"]["P_Coefficient"] = (21, 1)
    robot.bus.read = Mock(return_value=16)  # type: ignore[attr-defined]
    with pytest.raises(LrmError, match=r"shoulder_pan: P gain 16, was 32; .*accept_settings=True"):
        make(robot, str(other))
    assert make(robot, str(other), accept_settings=True)


def test_gains_of_the_motion_model_are_compared_too(model: str, motion: str, tmp_path: Path) -> None:
    """A model of motion whose recording stated the gains; the model of poses states none."""
    recorded = tmp_path / "motion.toml"
    recorded.write_text(Path(motion).read_text() + "[servos.shoulder_pan]\np = 32\n")
    make, robot = plug_in("pipelines").calibrated_processors, follower()
    robot.bus.model_ctrl_table["sts3215"]["P_Coefficient"] = (21, 1)
    robot.bus.read = Mock(return_value=16)  # type: ignore[attr-defined]
    assert make(robot, model, motion=motion)
    with pytest.raises(LrmError, match=r"not set as in .*motion\.toml.*shoulder_pan: P gain 16, was 32"):
        make(robot, model, motion=str(recorded))
