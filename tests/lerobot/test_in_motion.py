"""The side of friction in the plug-in: what a model of motion adds to the commands, and what never."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from shutil import copyfile
from typing import Any

import numpy as np
import pytest

from lerobot_robot_lrm.corrected_arm import CorrectedArm
from lerobot_robot_lrm.correction import Correction
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.motion import Motion
from lrm_math.model.model import model_of
from lrm_math.motion.motion_model import MotionModel
from tests.doors.lerobot_classes import plug_in
from tests.doors.servos_door import MODEL
from tests.support.lerobot.tracking_arm import hidden_arm, known_motion, motion_model_with, tracking
from tests.support.motion_models import motion_text, write_motion_model
from validation.motion.world import hand

ARM = load_arm("so101")
NOMINAL = model_of(ARM, ())
RUBBING = motion_model_with(
    {"dead_time.joint2.t_s": 0.05, "coulomb_friction.joint2.c_rad": 0.02, "motion_play.joint2.b_rad": 0.01}
)
RUBS = (("dead_time", "t_s"), ("coulomb_friction", "c_rad"), ("load_friction", "m_rad_per_Nm"))


def arm_in_motion(motion: MotionModel | None = RUBBING) -> CorrectedArm:
    correction = Correction.of(NOMINAL)
    arm = CorrectedArm("model.toml", correction.in_motion(motion) if motion else correction)
    arm.scale = np.ones(5)
    return arm


def action_of(arm: CorrectedArm, q: Any) -> dict[str, float]:
    return dict(zip(arm.keys, map(float, q), strict=True))


def sent(arm: CorrectedArm, wishes: Array) -> Array:
    """(N, 5), rad, commands for wishes (N, 5) of an arm that stands at the first one."""
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
    assert found.beyond["corrected"] < found.beyond["requests"] + 1.0


def test_nothing_moves_while_the_requests_stand_still() -> None:
    arm, still = arm_in_motion(), np.tile([0.1, 0.2, -0.3, 0.0, 0.4], (20, 1))
    commands = sent(arm, np.concatenate([still[:1] - 0.05, still]))
    np.testing.assert_array_equal(commands[3:], np.tile(commands[3], (18, 1)))
    trembling = still + np.where(np.arange(20) % 2, 1.0, -1.0)[:, None] * 0.4 * 2.0 * np.pi / 4096
    held = sent(arm, trembling)[:, 1]
    assert np.ptp(held[2:]) == 0.0


def test_no_command_leads_its_request() -> None:
    wishes = np.linspace([0.0] * 5, [0.5, 0.5, -0.5, 0.5, 0.5], 40)
    late_only = motion_model_with({"dead_time.joint2.t_s": 0.05})
    np.testing.assert_allclose(sent(arm_in_motion(late_only), wishes), wishes, atol=1e-9)
    np.testing.assert_allclose(sent(arm_in_motion(None), wishes), wishes, atol=1e-9)


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


def test_a_model_of_motion_of_another_arm_is_refused_in_one_line() -> None:
    correction = Correction.of(NOMINAL)
    with pytest.raises(LrmError, match="one of so100; should be one of so101"):
        correction.in_motion(MotionModel.nominal(load_arm("so100")))
    longer = replace(ARM, tool=replace(ARM.tool, z=0.2))
    with pytest.raises(LrmError, match="is not as in the model of poses: links, tool or masses differ"):
        correction.in_motion(MotionModel.nominal(longer))


def test_what_commands_do_not_use_of_a_model_of_motion_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    values = {"hysteresis.joint2.h_rad": -0.03}
    poses = Correction.of(model_of(ARM, effects_at(ARM, "hysteresis@joint2"), values))
    more = motion_model_with({f"{key}.joint{j}.{name}": 0.01 for key, name in RUBS for j in (2, 3)})
    with caplog.at_level(logging.WARNING):
        CorrectedArm("model.toml", poses.in_motion(more))
    assert caplog.messages == [
        "model.toml: not used of the model of motion: servo_response, rest_offset, dead_time, load_friction",
        "model.toml: friction and play of the model of motion are not used at shoulder_lift: "
        "the model of poses has an error by direction there",
    ]


def test_the_arm_of_a_model_of_motion_is_looked_up_beside_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder := tmp_path / "a").mkdir()
    copyfile(shipped_arms()["so101"], folder / "mine.toml")
    for name, text in (("model", MODEL), ("motion", motion_text(RUBBING))):
        (folder / f"{name}.toml").write_text(text.replace('arm = "so101"', 'arm = "mine.toml"'))
    monkeypatch.chdir(tmp_path)
    assert Correction.of_file("a/model.toml", motion="a/motion.toml").with_direction == ("shoulder_lift",)


def test_steps_with_a_relative_and_an_absolute_path_share_their_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (model := tmp_path / "model.toml").write_text(MODEL)
    motion = write_motion_model(RUBBING, tmp_path / "motion.toml")
    monkeypatch.chdir(tmp_path)
    steps = plug_in("processor")
    action = steps.CalibratedAction("model.toml", motion="motion.toml")
    assert action.get_config()["motion"] == "motion.toml"
    assert steps.CalibratedObservation(str(model), motion=str(motion)).arm is action.arm
    assert steps.CalibratedObservation(str(model)).arm is not action.arm
