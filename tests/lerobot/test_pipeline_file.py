"""LeRobot's own pipelines write the steps of the plug-in to their JSON file, and make them of it again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("lerobot", reason="LeRobot is not installed (it needs torch; Python 3.12 from 0.5 on)")

from lerobot.processor import RobotProcessorPipeline
from lerobot.processor.converters import robot_action_observation_to_transition, transition_to_robot_action

from lerobot_robot_lrm import CalibratedAction
from tests.doors.servos_door import MODEL, NAMES


def test_a_saved_pipeline_corrects_as_before(tmp_path: Path) -> None:
    (model := tmp_path / "model.toml").write_text(MODEL)
    turns = {"to_transition": robot_action_observation_to_transition, "to_output": transition_to_robot_action}
    made = RobotProcessorPipeline(steps=[CalibratedAction(str(model), 20.0, prefix="left_")], name="left arm", **turns)
    made.save_pretrained(tmp_path)
    (file,) = tmp_path.glob("*.json")
    (step,) = json.loads(file.read_text())["steps"]
    assert step["registry_name"] == "lrm_calibrated_action"
    assert step["config"]["payload_g"] == 20.0
    loaded = RobotProcessorPipeline.from_pretrained(tmp_path, config_filename=file.name, **turns)
    at = {f"left_{name}.pos": 0.0 for name in NAMES}
    wish = {**at, "left_elbow_flex.pos": 20.0, "left_gripper.pos": 40.0, "right_elbow_flex.pos": 3.0}
    made.reset()
    first = made((wish, at))
    loaded.reset()
    assert loaded((wish, at)) == first
    assert first["left_gripper.pos"] == 40.0
    assert first["right_elbow_flex.pos"] == 3.0
    assert first["left_elbow_flex.pos"] != 20.0
