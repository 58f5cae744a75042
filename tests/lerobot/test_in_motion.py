"""Dead time and the side of friction in the plug-in: what a model of motion adds to the commands, and what never."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lerobot_robot_lrm.corrected_arm import CorrectedArm
from lerobot_robot_lrm.correction import Correction
from lerobot_robot_lrm.path_ahead import PathAhead
from lerobot_robot_lrm.servo_motion import ServoMotion
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.motion import Motion
from lrm_math.model.model import model_of
from lrm_math.motion.base import JointDrive
from lrm_math.motion.motion_model import MotionModel
from lrm_math.motion.simulation import simulate
from tests.doors.lerobot_classes import plug_in
from tests.doors.servos_door import MODEL
from tests.support.motion_models import write_motion_model
from validation.lerobot_robot.in_motion import hidden_arm, known_motion, motion_of, tracking
from validation.motion.world import hand

ARM = load_arm("so101")
NOMINAL = model_of(ARM, ())
PATHS = st.lists(st.lists(st.floats(-0.8, 0.8), min_size=5, max_size=5), min_size=1, max_size=12).map(np.array)


RUBBING = motion_of(
    {"dead_time.joint2.t_s": 0.05, "coulomb_friction.joint2.c_rad": 0.02, "motion_play.joint2.b_rad": 0.01}
)


def arm_in_motion(motion: MotionModel | None = RUBBING) -> CorrectedArm:
    correction = Correction.of(NOMINAL)
    arm = CorrectedArm("model.toml", correction.in_motion(motion) if motion else correction)
    arm.scale = np.ones(5)
    return arm


def action_of(arm: CorrectedArm, q: Any) -> dict[str, float]:
    return dict(zip(arm.keys, map(float, q), strict=True))


def sent(arm: CorrectedArm, wishes: Array, announced: Array | None = None) -> Array:
    """(N, 5), rad, commands for wishes (N, 5) of an arm that stands at the first one."""
    if announced is not None:
        arm.announce([action_of(arm, q) for q in announced], 30.0)
    out = []
    for wish in wishes:
        asked = arm.corrected(action_of(arm, wish), lambda: action_of(arm, wishes[0]))
        arm.follow(asked, asked.action)
        out.append([asked.action[key] for key in arm.keys])
    return np.array(out)


def test_a_hidden_arm_stops_and_follows_nearer_to_the_requests() -> None:
    rng = np.random.default_rng([64, 100])
    hidden = hidden_arm(rng)
    found = tracking(hidden, known_motion(hidden), hand(rng)[:240], rng)
    assert found.at_stops["corrected"] < 0.6 * found.at_stops["requests"]
    assert found.everywhere["corrected"] < found.everywhere["requests"]
    assert found.everywhere["announced"] < 0.2 * found.everywhere["requests"]
    assert found.beyond["announced"] < found.beyond["requests"] + 1.0


@given(path=PATHS, delay=st.lists(st.floats(0.0, 0.4), min_size=5, max_size=5).map(np.array))
def test_a_lead_stays_on_the_path_that_is_left_and_ends_at_its_end(path: Array, delay: Array) -> None:
    ahead: PathAhead | None = PathAhead(path, 1.0 / 30.0)
    for k, wish in enumerate(path):
        assert ahead is not None
        ahead = ahead.after(wish)
        assert ahead is not None
        led, left = ahead.led(delay), path[k:]
        assert (led >= left.min(axis=0) - 1e-12).all()
        assert (led <= left.max(axis=0) + 1e-12).all()
    assert ahead is not None
    np.testing.assert_array_equal(ahead.led(delay), path[-1])
    assert ahead.after(path[-1]) is None


def test_nothing_moves_while_the_requests_stand_still() -> None:
    arm, still = arm_in_motion(), np.tile([0.1, 0.2, -0.3, 0.0, 0.4], (20, 1))
    commands = sent(arm, np.concatenate([still[:1] - 0.05, still]), np.concatenate([still[:1] - 0.05, still]))
    np.testing.assert_array_equal(commands[3:], np.tile(commands[3], (18, 1)))
    trembling = still + np.where(np.arange(20) % 2, 1.0, -1.0)[:, None] * 0.4 * 2.0 * np.pi / 4096
    held = sent(arm, trembling)[:, 1]
    assert np.ptp(held[2:]) == 0.0


def test_without_an_announced_path_no_command_leads_its_request() -> None:
    wishes = np.linspace([0.0] * 5, [0.5, 0.5, -0.5, 0.5, 0.5], 40)
    late_only = motion_of({"dead_time.joint2.t_s": 0.05})
    np.testing.assert_allclose(sent(arm_in_motion(late_only), wishes), wishes, atol=1e-9)
    np.testing.assert_allclose(sent(arm_in_motion(None), wishes), wishes, atol=1e-9)


def test_a_lead_ends_with_the_first_action_that_is_another(caplog: pytest.LogCaptureFixture) -> None:
    arm, path = arm_in_motion(motion_of({})), np.linspace([0.0] * 5, [0.6] * 5, 30)
    other = np.concatenate([path[:10], np.tile(path[9], (3, 1))])
    with caplog.at_level(logging.WARNING):
        commands = sent(arm, other, path)
    assert (commands[5:10] > path[5:10] + 0.01).all()
    np.testing.assert_allclose(commands[10:], other[10:], atol=1e-9)
    assert sum("is not the announced one" in text for text in caplog.messages) == 1
    arm.forget()
    np.testing.assert_allclose(sent(arm, path), path, atol=1e-9)


def test_a_path_that_cannot_be_led_is_refused() -> None:
    arm = arm_in_motion(None)
    with pytest.raises(LrmError, match="no model of motion is deployed"):
        arm.announce([action_of(arm, np.zeros(5))], 30.0)
    arm = arm_in_motion()
    for actions, fps in (([], 30.0), ([action_of(arm, np.zeros(5))], 0.0), ([action_of(arm, np.zeros(5))], np.nan)):
        with pytest.raises(LrmError, match="are announced; should be some"):
            arm.announce(actions, fps)
    with pytest.raises(LrmError, match="one of so100; should be one of so101"):
        Correction.of(NOMINAL).in_motion(MotionModel.nominal(load_arm("so100")))


def test_encoders_show_the_friction_of_a_servo_and_commands_reach_beyond_it() -> None:
    made = Correction.of(NOMINAL).in_motion(RUBBING)
    start, goal = Motion.at(np.zeros(5)), np.full(5, 0.3)
    command = made.command(goal, start)
    np.testing.assert_allclose(command - goal, [0.0, 0.025, 0.0, 0.0, 0.0], atol=1e-6)
    arrived = start.to(command)
    np.testing.assert_allclose(made.true_angles(goal, arrived), goal, atol=1e-6)
    np.testing.assert_allclose(made.reached(command, arrived), goal, atol=1e-6)


def test_friction_that_the_model_of_poses_has_already_counts_once() -> None:
    values = {"hysteresis.joint2.h_rad": -0.03}
    poses = Correction.of(model_of(ARM, effects_at(ARM, "hysteresis@joint2"), values))
    both, start, goal = poses.in_motion(RUBBING), Motion.at(np.zeros(5)), np.full(5, 0.3)
    assert both.seen == ()
    np.testing.assert_array_equal(both.command(goal, start), poses.command(goal, start))


@pytest.mark.parametrize("lead", [0.0, 0.02])
def test_the_delay_is_that_of_a_slow_ramp(lead: float) -> None:
    servo = {"servo_response.joint2.frequency_Hz": 4.0, "servo_response.joint2.damping_ratio": 0.9}
    values = servo | {"dead_time.joint2.t_s": 0.05}
    model = motion_of(values | ({"velocity_feedforward.joint2.t_s": lead} if lead else {}))
    effects, h, rate = model.of_joint(1), 0.002, 0.2
    ramp: Array = rate * h * np.arange(1500.0)[:, None]
    none: Array = np.zeros_like(ramp)
    drive = JointDrive(h, ramp, none, none, none, 0.0, np.zeros(1), np.zeros(1))
    late = simulate(effects, [[np.full((1, 1), model.values[key]) for key in effect.keys] for effect in effects], drive)
    assert ServoMotion.of(model).delay[1] == pytest.approx((ramp[-1, 0] - late[-1, 0, 0]) / rate, abs=1.5 * h)


def test_processor_steps_take_a_model_of_motion_and_announced_actions(tmp_path: Any) -> None:
    (model := tmp_path / "model.toml").write_text(MODEL)
    motion = write_motion_model(motion_of({"dead_time.joint1.t_s": 0.1}), tmp_path / "motion.toml")
    steps = plug_in("processor")
    plain, step = steps.CalibratedAction(str(model)), steps.CalibratedAction(str(model), motion=str(motion))
    assert step.get_config()["motion"] == str(motion)
    names = [key.removesuffix(".pos") for key in step.arm.keys]
    path = [dict.fromkeys((f"{name}.pos" for name in names), 0.5 * k) for k in range(10)]
    step.announce(path, 30.0)
    first = [one({"action": path[0], "observation": path[0]})["action"]["shoulder_pan.pos"] for one in (plain, step)]
    assert first[1] - first[0] > 1.0
