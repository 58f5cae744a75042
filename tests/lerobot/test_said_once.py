"""Bounds of the calibrated robot are said once each, in the log, and what it sends is within them."""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from examples.so101.feetech_servo import FeetechServo
from lerobot_robot_lrm.bounded import CREEP, RATE
from tests.doors.lerobot_classes import calibrated_robot_class, robot_config
from tests.doors.servos_door import NAMES
from tests.doors.simulated_follower import SimulatedFollower
from tests.lerobot.test_continuity import near_its_axis

TWISTED = """\
schema = "lrm/model/1"
arm = "so101"
effects = ["offsets"]
[parameters]
"offsets.joint2.alpha_rad" = 0.02
"offsets.joint2.a_mm" = 0.004
"""


def test_where_accuracy_is_given_up_it_is_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (model := tmp_path / "model.toml").write_text(TWISTED)
    follower = SimulatedFollower(NAMES, [FeetechServo(number) for number in range(1, 6)])
    robot = calibrated_robot_class()(robot_config(model), follower)
    robot.connect()
    start = near_its_axis(robot.correction, np.array([0.2, 0.0, 0.6, 0.3, 0.0]))
    step, before = np.radians(0.3), None
    with caplog.at_level(logging.WARNING):
        for k in range(-40, 41):
            wish = start + k * step * np.array([0.0, 1.0, 0.0, 0.0, 0.0])
            robot.send_action(dict(zip((f"{name}.pos" for name in NAMES), np.degrees(wish).tolist(), strict=True)))
            sent = robot.arm.motion.q
            if before is not None:
                assert np.abs(sent - before).max() <= (1.0 + RATE) * step + CREEP
            before = sent
    assert sum("the tip stays more than 2 mm beside its goal" in text for text in caplog.messages) == 1
    assert max(Counter(caplog.messages).values()) == 1
