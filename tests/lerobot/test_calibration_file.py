"""LeRobot loads a corrected calibration file, and reads the true angle through it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from lrm_ident.data.robot_files.lerobot_calibration import calibration_text, corrected
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.model.model import model_of

pytest.importorskip("lerobot", reason="LeRobot is not installed (it needs torch; Python 3.12 from 0.5 on)")
pytest.importorskip("scservo_sdk", reason="feetech-servo-sdk is not installed")

from lerobot.robots.so_follower import SO101Follower, SO101FollowerConfig

from validation.lerobot_robot.simulated_follower import MOTORS

OFFSETS = {"shoulder_lift": 0.05, "wrist_roll": -0.03}


def test_lerobot_loads_it_and_reads_the_true_angle(tmp_path: Path) -> None:
    motor = {"drive_mode": 0, "homing_offset": 100, "range_min": 900, "range_max": 3100}
    motors = {name: {"id": number, **motor} for number, name in enumerate(MOTORS, start=1)}
    motors["wrist_roll"] |= {"range_min": 0, "range_max": 4095}
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(motors))
    arm = load_arm("so101")
    values = {f"offsets.joint{MOTORS.index(name) + 1}.theta_rad": offset for name, offset in OFFSETS.items()}
    (tmp_path / "true.json").write_text(
        calibration_text(corrected(path, model_of(arm, effects_at(arm, "offsets"), values)))
    )
    read = {}
    for name in ("mine", "true"):
        robot = SO101Follower(SO101FollowerConfig(port="none", id=name, calibration_dir=tmp_path, use_degrees=True))
        counts = {number: 2000 - robot.calibration[motor].homing_offset for number, motor in enumerate(MOTORS, start=1)}
        read[name] = robot.bus._normalize(counts)
    for number, motor in enumerate(MOTORS, start=1):
        told = math.radians(read["true"][number] - read["mine"][number])
        assert told == pytest.approx(OFFSETS.get(motor, 0.0), abs=math.pi / 4095.0 + 1e-9)
