"""A reply that came after its time is no answer to the next request, on the servo makers' own port."""

from __future__ import annotations

import os
import pty
import select
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from examples.so101.feetech_servo import FeetechServo
from lrm_ident.measuring.campaign import lerobot_robot
from lrm_math.arm.lerobot_late_replies import drop_late_replies
from tests.doors.lerobot_classes import plug_in
from tests.doors.servos_door import MODEL, NAMES
from tests.doors.simulated_follower import SimulatedFollower

pytest.importorskip("lerobot")
sdk = pytest.importorskip("scservo_sdk")

PING, LATE, FRESH = [0xFF, 0xFF, 1, 2, 1, 0], bytes([0xFF, 0xFF, 1, 2, 0, 0xFC]), bytes([0xFF, 0xFF, 1, 2, 4, 0xF8])


@pytest.mark.parametrize("dropped", [True, False])
def test_a_late_reply_is_not_read_as_the_next_one(dropped: bool) -> None:
    """With the kit's own `clearPort` it is, which is why it is replaced."""
    servos, ours = pty.openpty()
    port = sdk.PortHandler(os.ttyname(ours))
    port.openPort()
    if dropped:
        drop_late_replies(SimpleNamespace(bus=SimpleNamespace(port_handler=port)))
    packets: Any = sdk.protocol_packet_handler()
    os.write(servos, LATE)
    assert select.select([ours], [], [], 5.0)[0]
    packets.txPacket(port, [*PING])
    port.is_using = False
    os.write(servos, FRESH)
    port.setPacketTimeoutMillis(5000)
    read, result = packets.rxPacket(port)
    port.closePort()
    os.close(servos)
    assert result == sdk.COMM_SUCCESS
    assert bytes(read) == (FRESH if dropped else LATE)


def test_a_robot_without_a_bus_is_left_as_it_is() -> None:
    """Robots that drive no bus of servos have no such port."""
    drop_late_replies(SimpleNamespace())
    drop_late_replies(SimpleNamespace(bus=SimpleNamespace()))


class Port:
    """A line that holds a late reply whenever it is asked to be clear."""

    def __init__(self) -> None:
        self.ser = SimpleNamespace(reset_input_buffer=self.empty)
        self.late = True

    def empty(self) -> None:
        self.late = False

    def clearPort(self) -> None:  # noqa: N802  (the kit's name)
        """Waits for the output."""


def test_the_robot_beside_the_processor_steps_drops_them(tmp_path: Path) -> None:
    robot, port = SimulatedFollower(NAMES, [FeetechServo(number) for number in range(1, 6)]), Port()
    robot.connect()
    robot.bus.port_handler = port  # type: ignore[attr-defined]
    model = tmp_path / "model.toml"
    model.write_text(MODEL)
    plug_in("pipelines").calibrated_processors(robot, str(model))
    port.clearPort()
    assert not port.late


def test_a_robot_that_measures_drops_them_before_it_is_connected(monkeypatch: pytest.MonkeyPatch) -> None:
    port = Port()

    def connect(calibrate: bool) -> None:  # noqa: ARG001
        port.clearPort()
        assert not port.late

    bus = SimpleNamespace(port_handler=port)
    robot = SimpleNamespace(bus=bus, connect=connect, is_calibrated=True, disconnect=lambda: None)
    monkeypatch.setattr(lerobot_robot, "robot_of", lambda _: robot)
    with lerobot_robot.connected_robot("lerobot:so101_follower"):
        assert not port.late
