"""A reply that came after its time is no answer to the next request, on the servo makers' own port."""

from __future__ import annotations

import os
import pty
import select
from types import SimpleNamespace
from typing import Any

import pytest

from lrm_math.arm.lerobot_late_replies import drop_late_replies

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
