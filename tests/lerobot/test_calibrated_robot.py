"""LeRobot's real `SOFollower` over the simulated Feetech bus, with the calibrated form around it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import make_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lrm_math.errors import LrmError

pytest.importorskip("lerobot", reason="LeRobot is not installed (it needs torch; Python 3.12 from 0.5 on)")
pytest.importorskip("scservo_sdk", reason="feetech-servo-sdk is not installed")

import lerobot_robot_lrm  # noqa: F401  (registers, where it is not installed for LeRobot to find)
from examples.so101.launch import simulated_so101
from validation.lerobot_robot.closed_loop import closed_loop
from validation.lerobot_robot.simulated_follower import MOTORS, follower, with_retries

MODEL = """\
schema = "lrm/model/1"
arm = "so101"
effects = ["offsets", "compliance", "hysteresis@joint2", "drift@joint1"]
[parameters]
"offsets.joint2.theta_rad" = 0.03
"compliance.joint2.k_rad_per_Nm" = 0.05
"hysteresis.joint2.h_rad" = -0.03
"""
KIND = "so101_follower_calibrated"


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "model.toml"
    path.write_text(MODEL)
    return path


@pytest.fixture
def link(tmp_path: Path) -> Iterator[Path]:
    with simulated_so101(tmp_path, "gain", 1) as made:
        yield made


def action_of(*angles: float) -> dict[str, float]:
    return {f"{name}.pos": value for name, value in zip(MOTORS, (*angles, 40.0), strict=True)}


def test_wishes_go_out_corrected_and_come_back_as_true_angles(
    link: Path, model: Path, caplog: pytest.LogCaptureFixture
) -> None:
    wish = action_of(10.0, 20.0, -15.0, 5.0, 30.0)
    with caplog.at_level(logging.WARNING), follower(link, KIND, model=str(model)) as robot:
        assert robot.name == "so_follower_calibrated"
        assert robot.bus is robot.robot.bus
        sent = with_retries(robot, lambda: robot.send_action(wish))
        assert {name: pytest.approx(value) for name, value in wish.items()} == sent
        goal = with_retries(robot, lambda: robot.bus.sync_read("Goal_Position"))
        assert abs(goal["shoulder_lift"] - 20.0) > 0.5
        assert goal["gripper"] == pytest.approx(40.0, abs=0.1)
        while any(with_retries(robot, lambda: robot.bus.sync_read("Moving")).values()):
            pass
        seen = with_retries(robot, robot.get_observation)
    for name in MOTORS[:-1]:
        assert seen[f"{name}.pos"] == pytest.approx(wish[f"{name}.pos"], abs=0.4)
    assert sum("drift@joint1" in text for text in caplog.messages) == 1


def test_a_clipped_command_is_remembered_and_reported_as_it_was_sent(link: Path, model: Path) -> None:
    with follower(link, KIND, model=str(model), max_relative_target="5.0") as robot:
        sent = with_retries(robot, lambda: robot.send_action(action_of(30.0, 30.0, 30.0, 30.0, 30.0)))
        assert max(abs(sent[f"{name}.pos"]) for name in MOTORS[:-1]) < 9.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda action: action.pop("elbow_flex.pos"), "the action has no 'elbow_flex.pos'; it has gripper.pos"),
        (lambda action: action.update({"wrist_roll.pos": float("nan")}), "'wrist_roll.pos' = nan"),
    ],
)
def test_a_bad_action_is_one_clear_line(link: Path, model: Path, change: Any, said: str) -> None:
    action = action_of(0.0, 0.0, 0.0, 0.0, 0.0)
    change(action)
    with follower(link, KIND, model=str(model)) as robot, pytest.raises(LrmError, match=said):
        robot.send_action(action)


def test_after_a_supply_that_dropped_no_goal_is_sent(link: Path, model: Path) -> None:
    """A goal would switch the torque on again, from wherever the arm has fallen."""
    with follower(link, KIND, model=str(model)) as robot:
        with_retries(robot, lambda: robot.send_action(action_of(0.0, 0.0, 0.0, 0.0, 0.0)))
        with_retries(robot, lambda: robot.bus.write("Torque_Enable", "elbow_flex", 0))
        with pytest.raises(LrmError, match=r"^elbow_flex lost torque: was the supply off\?"):
            with_retries(robot, lambda: robot.send_action(action_of(5.0, 5.0, 5.0, 5.0, 5.0)))
        torques = with_retries(robot, lambda: robot.bus.sync_read("Torque_Enable"))
    assert [name for name, on in torques.items() if not on] == ["elbow_flex"]


def test_a_model_of_another_arm_is_one_clear_line(link: Path, tmp_path: Path) -> None:
    other = tmp_path / "ur5.toml"
    other.write_text('schema = "lrm/model/1"\narm = "ur5"\neffects = ["offsets"]\n')
    with (
        pytest.raises(ValueError, match=r"model of the arm 'ur5', whose 'joint1' so_follower does not have"),
        follower(link, KIND, model=str(other)),
    ):
        pass


@pytest.mark.slow
@pytest.mark.parametrize("effect", ["play", "friction", "gain"])
def test_the_tip_ends_at_the_floor_from_both_sides(effect: str, tmp_path: Path) -> None:
    found = closed_loop(effect, 1, tmp_path)
    print(f"{effect}: {1e3 * found.without:.2f} mm without, {1e3 * found.calibrated:.2f} calibrated")
    print(f"floor {1e3 * found.floor:.2f} mm, observed off the wish by {np.degrees(found.observed):.2f} deg")
    assert found.calibrated < 1.4 * found.floor
    assert found.without > 3.0 * found.floor


@pytest.mark.parametrize(
    ("kind", "models"), [(KIND, ["model"]), ("bi_so_follower_calibrated", ["left_model", "right_model"])]
)
def test_the_lead_is_an_option_of_every_calibrated_form(kind: str, models: list[str]) -> None:
    """As LeRobot's programs read it; off if it is not given."""
    draccus = pytest.importorskip("draccus")
    config = make_dataclass("Program", [("robot", pytest.importorskip("lerobot.robots.config").RobotConfig)])
    ports = ["port"] if kind == KIND else ["left_arm_config.port", "right_arm_config.port"]
    typed = [f"--robot.type={kind}", *(f"--robot.{name}=word" for name in (*ports, *models))]
    assert draccus.parse(config, args=typed).robot.lead is False
    assert draccus.parse(config, args=[*typed, "--robot.lead=true"]).robot.lead is True
