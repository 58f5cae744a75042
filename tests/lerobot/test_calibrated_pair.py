"""Two arms of LeRobot, each corrected by its own model: the calibrated pair."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from examples.so101.feetech_servo import FeetechServo
from lerobot_robot_lrm.correction import Correction
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.kinematics.motion import Motion
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.doors.lerobot_classes import calibrated_robot_class, plug_in, robot_config
from tests.doors.servos_door import MODEL, NAMES
from tests.doors.simulated_follower import SIDES, SimulatedFollower, SimulatedPair
from tests.lerobot.test_processor import MEASURED_WITH

OTHER = MODEL.replace('theta_rad" = 0.03', 'theta_rad" = -0.02')
WISHES = np.radians([[10.0, 20.0, -15.0, 5.0, 30.0], [-20.0, 5.0, 10.0, -10.0, 0.0]])
APART_M = 0.4


def pair_of(folder: Path, left: str, right: str, **options: Any) -> Any:
    (folder / "left.toml").write_text(left)
    (folder / "right.toml").write_text(right)
    arms = [SimulatedFollower(NAMES, [FeetechServo(number) for number in range(1, 6)]) for _ in SIDES]
    for arm in arms:
        arm.bus.model_ctrl_table["sts3215"]["P_Coefficient"] = (21, 1)
        arm.bus.read = Mock(return_value=16)  # type: ignore[attr-defined]
    given = {"left_payload_g": 0.0, "right_payload_g": 0.0, "base": "each", "keep": "base,tool"}
    given |= {"left_motion": "", "right_motion": "", "lead": False}
    models = {f"{side}model": str(folder / f"{side}.toml".replace("_", "")) for side in SIDES}
    config = SimpleNamespace(**{**given, "accept_settings": False, **models, **options})
    return plug_in("calibrated_pair").CalibratedPair(config, SimulatedPair(*arms))


def action_of(side: str, q: np.ndarray) -> dict[str, float]:
    return {f"{side}{name}.pos": float(np.degrees(angle)) for name, angle in zip(NAMES, q, strict=True)}


def test_each_arm_goes_as_its_own_calibrated_robot_would(tmp_path: Path) -> None:
    pair = pair_of(tmp_path, MODEL, OTHER)
    pair.connect()
    sent = pair.send_action({**action_of("left_", WISHES[0]), **action_of("right_", WISHES[1]), "left_x": 1.0})
    assert sent["left_x"] == 1.0
    for side, wish, arm in zip(SIDES, WISHES, (pair.robot.left_arm, pair.robot.right_arm), strict=True):
        alone = SimulatedFollower(NAMES, [FeetechServo(number) for number in range(1, 6)])
        model = str(tmp_path / f"{side.removesuffix('_')}.toml")
        config = robot_config(model)
        robot = calibrated_robot_class()(config, alone)
        robot.connect()
        own = robot.send_action(action_of("", wish))
        goals = [[servo.target for servo in each.bus.servos.values()] for each in (alone, arm.robot)]
        assert goals[0] == goals[1]
        assert {key: sent[f"{side}{key}"] for key in own} == pytest.approx(own)
    assert pair.get_observation()["left_shoulder_pan.pos"] != pair.get_observation()["right_shoulder_pan.pos"]


def test_an_arm_with_other_gains_than_measured_is_refused_and_neither_keeps_torque(tmp_path: Path) -> None:
    pair = pair_of(tmp_path, MODEL, MODEL + MEASURED_WITH)
    with pytest.raises(LrmError, match="shoulder_pan: P gain 16, was 32"):
        pair.connect()
    for arm in (pair.robot.left_arm, pair.robot.right_arm):
        assert not any(servo.powered for servo in arm.bus.servos.values())
    pair_of(tmp_path, MODEL, MODEL + MEASURED_WITH, accept_settings=True).connect()


def test_a_base_that_is_none_and_a_model_of_another_arm_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(LrmError, match="unknown base 'middle'; valid: each, left, right"):
        pair_of(tmp_path, MODEL, MODEL, base="middle")
    with pytest.raises(LrmError, match="a model of the arm 'ur5', whose 'joint1'"):
        pair_of(tmp_path, MODEL, 'schema = "lrm/model/1"\narm = "ur5"\neffects = ["offsets"]\n')


def standing(y: float, off: dict[str, float]) -> Model:
    """An SO-101 that is drawn with its base so far along y (m), and really stands a little off."""
    arm = load_arm("so101")
    arm = replace(arm, base=replace(arm.base, y=arm.base.y + y))
    errors = {"offsets.joint2.theta_rad": 0.02, **{f"offsets.base.{key}": value for key, value in off.items()}}
    return model_of(arm, effects_at(arm, "offsets"), errors)


def tip(model: Model, q: np.ndarray) -> np.ndarray:
    return np.asarray(solve_equilibrium(model, Poses(q[None], np.zeros(1), np.zeros((1, len(q))))).tcp[0])


def test_with_one_base_the_tips_stand_to_each_other_as_drawn() -> None:
    """The tracker stood anywhere, which is no error; that the right base is 6 mm nearer is one, and is corrected."""
    left, right = standing(0.0, {"x_mm": 0.05, "y_mm": 0.02}), standing(-APART_M, {"x_mm": 0.05, "y_mm": 0.026})
    drawn = [model_of(model.arm, ()) for model in (left, right)]
    one = Correction.of(left)
    for two, expected in (
        (Correction.of(right), 0.006),
        (Correction.of(right).on_the_base_of(one), 0.0),
    ):
        off = []
        for wish in WISHES:
            tips = [
                tip(model, made.command(wish, Motion.at(wish)))
                for model, made in zip((left, right), (one, two), strict=True)
            ]
            as_drawn = [tip(model, wish) for model in drawn]
            off.append(np.linalg.norm((tips[0] - tips[1]) - (as_drawn[0] - as_drawn[1])))
            command = two.command(wish, Motion.at(wish))
            seen = two.true_angles(command, Motion.at(command))
            np.testing.assert_allclose(tip(drawn[1], seen), tip(drawn[1], wish), atol=3e-4)
        assert max(off) == pytest.approx(expected, abs=3e-4)


def test_bases_that_stand_far_from_what_the_arm_files_say_are_refused() -> None:
    left, right = standing(0.0, {}), standing(0.0, {"y_mm": -APART_M})
    with pytest.raises(LrmError, match=r"the bases stand 400 mm and 0\.0 deg beside where the arm files say"):
        Correction.of(right).on_the_base_of(Correction.of(left))
