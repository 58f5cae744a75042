"""A real serial line whose other end is gone, as when a USB adapter is pulled out, at whatever is asked next."""

from __future__ import annotations

import os
import pty
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import pytest
import serial

from lrm_ident.measuring.campaign.lerobot_robot import LeRobotServos
from lrm_ident.measuring.campaign.servo_arm import ServoArm, Servos
from lrm_ident.measuring.servo_bus import feetech as table
from lrm_ident.measuring.servo_bus.bus import NoAnswer, ServoHost
from lrm_ident.measuring.servo_bus.feetech import FEETECH
from lrm_ident.measuring.servo_bus.servos import BusServos
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError

ARM = load_arm("so101")
ASKED: dict[str, Callable[[ServoHost], object]] = {
    "read": lambda host: host.read(1, table.POSITION),
    "memory": lambda host: host.memory(1),
    "read_all": lambda host: host.read_all([1, 2], table.POSITION),
    "write": lambda host: host.write(1, table.TORQUE_ENABLE, 1),
    "write_with_retries": lambda host: host.write_with_retries(1, table.TORQUE_ENABLE, 1),
    "move": lambda host: host.move({1: 2048}),
    "forget_late_answers": ServoHost.forget_late_answers,
}


NAMES = tuple(str(joint.name) for joint in ARM.joints)


def of_lerobot(line: serial.Serial) -> LeRobotServos:
    """Servos of a robot of LeRobot, which lets through what its serial line raises."""

    def asked(*_: object) -> dict[str, float]:
        line.write(b"?")
        return {}

    handler = SimpleNamespace(ser=line)
    bus = SimpleNamespace(port_handler=handler, sync_read=asked, motors={}, model_ctrl_table={})
    robot = SimpleNamespace(name="so_follower", bus=bus, get_observation=asked, send_action=asked)
    return LeRobotServos(robot, NAMES)


def of_bus(line: serial.Serial) -> BusServos:
    return BusServos("feetech:/dev/x", ServoHost(line, FEETECH), NAMES, (1, 2, 3, 4, 5), ((0, 4095),) * 5)


@pytest.fixture
def unplugged() -> Iterator[serial.Serial]:
    far, near = pty.openpty()
    with serial.Serial(os.ttyname(near), 1_000_000, timeout=0.01, write_timeout=1.0) as line:
        os.close(near)
        os.write(far, b"late")
        os.close(far)
        yield line


@pytest.mark.parametrize("asked", ASKED)
def test_whatever_is_asked_says_that_the_line_is_gone(unplugged: serial.Serial, asked: str) -> None:
    with pytest.raises(NoAnswer, match="the serial line is gone"):
        ASKED[asked](ServoHost(unplugged, FEETECH))


@pytest.mark.parametrize("servos_of", [of_bus, of_lerobot])
def test_a_campaign_says_in_one_line_that_nobody_answers(
    unplugged: serial.Serial, servos_of: Callable[[serial.Serial], Servos]
) -> None:
    servos = servos_of(unplugged)
    with pytest.raises(LrmError, match=r"^[^\n]+ does not answer: [^\n]+$"):
        ServoArm(servos, ARM, Instant(), lambda _: None)


class Instant:
    """Clock of which no time passes."""

    def now(self) -> float:
        return 0.0

    def sleep(self, seconds: float) -> None:
        pass
