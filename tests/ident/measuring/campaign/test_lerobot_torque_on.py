"""LeRobot's torque on, for a campaign: where the motors stand, none beyond its limits, and none is taken before."""

from __future__ import annotations

import logging
import math

import pytest

from examples.so101.feetech_servo import MIDDLE, STEP, FeetechServo
from lrm_ident.measuring.campaign import lerobot_robot
from lrm_ident.measuring.campaign.lerobot_robot import connected_robot
from lrm_ident.measuring.servo_bus import feetech as table
from lrm_math.arm.lerobot_torque_on import torque_on_where_they_stand
from lrm_math.errors import LrmError
from tests.doors.servos_door import NAMES
from tests.doors.simulated_follower import GoalKeepingServo, SimulatedFollower

ROBOT = "lerobot:so101_follower"
OLD_GOAL, FALL_DEG = 3500, 40.0


class FallingServo(GoalKeepingServo):
    """Falls as soon as it has no torque."""

    def write(self, address: int, data: bytes) -> None:
        held = self.powered
        super().write(address, data)
        if held and not self.powered:
            self.angle -= math.radians(FALL_DEG)


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> SimulatedFollower:
    made = SimulatedFollower(NAMES, [FallingServo(number) for number in range(1, 6)])
    for servo in made.bus.servos.values():
        servo.angle = (1500 - MIDDLE) * STEP
        table.GOAL_POSITION.write(servo.memory, OLD_GOAL)
    monkeypatch.setattr(lerobot_robot, "robot_of", lambda _: made)
    return made


def turned(robot: SimulatedFollower) -> float:
    """Largest turn (rad) since the beginning, after a while."""
    servos: list[FeetechServo] = list(robot.bus.servos.values())
    for servo in servos:
        servo.advance(10.0)
    return max(abs(servo.angle - (1500 - MIDDLE) * STEP) for servo in servos)


def test_a_campaign_gives_torque_where_the_motors_stand_whatever_their_old_goals(robot: SimulatedFollower) -> None:
    with connected_robot(ROBOT):
        assert all(servo.powered for servo in robot.bus.servos.values())
        assert turned(robot) < 1e-9


def test_where_one_stands_beyond_its_limits_none_gets_torque(robot: SimulatedFollower) -> None:
    table.MIN_POSITION.write(robot.bus.servos["elbow_flex"].memory, 1700)
    said = r"^--robot lerobot:so101_follower: elbow_flex stands at -48\.2 deg, 17\.6 deg beyond its servo's own limits"
    with pytest.raises(LrmError, match=said), connected_robot(ROBOT):
        pass
    assert not any(servo.powered for servo in robot.bus.servos.values())
    assert turned(robot) < 1e-9


def test_an_arm_that_holds_is_not_dropped(robot: SimulatedFollower, caplog: pytest.LogCaptureFixture) -> None:
    for servo in robot.bus.servos.values():
        table.GOAL_POSITION.write(servo.memory, 1500)
        table.TORQUE_ENABLE.write(servo.memory, 1)
    with caplog.at_level(logging.WARNING), connected_robot(ROBOT):
        assert turned(robot) < 1e-9
    assert "so_follower holds already" in caplog.text


def test_after_a_failure_the_motors_are_set_again(robot: SimulatedFollower) -> None:
    """Those that were switched on before it hold, and may not be set yet."""
    configured, own = [], robot.configure

    def fails_once() -> None:
        configured.append(True)
        own()
        if len(configured) == 1:
            raise ConnectionError("no status packet")

    robot.configure = fails_once  # type: ignore[method-assign]
    robot.disconnect = lambda: setattr(robot, "is_connected", False)  # type: ignore[method-assign]
    torque_on_where_they_stand(robot)
    with pytest.raises(ConnectionError):
        robot.connect()
    robot.connect()
    assert len(configured) == 2


def test_no_goal_is_sent_to_motors_whose_supply_was_off(robot: SimulatedFollower) -> None:
    """LeRobot's own loops do not look: the first goal would switch them on, from wherever they have fallen."""
    torque_on_where_they_stand(robot)
    robot.connect()
    there = {f"{name}.pos": math.degrees((1500 - MIDDLE) * STEP) for name in NAMES}
    robot.send_action(there)
    dropped = robot.bus.servos["elbow_flex"]
    dropped.power_cycle()
    dropped.angle = -1.0
    for _ in range(3):
        with pytest.raises(LrmError, match=r"^elbow_flex lost torque: was the supply off\?"):
            robot.send_action(there)
    assert not dropped.powered
    dropped.advance(10.0)
    assert dropped.angle == -1.0
