"""Dynamixel servos over a line that is the simulated bus: packets byte by byte, and the arm that the host drives."""

from __future__ import annotations

from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples.so101.dynamixel_bus import DynamixelServo
from examples.so101.feetech_servo import STEP
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.servo_arm import TORQUE, ServoArm
from lrm_ident.measuring.servo_bus import dynamixel as table
from lrm_ident.measuring.servo_bus.bus import ServoHost
from lrm_ident.measuring.servo_bus.dynamixel import DYNAMIXEL, DynamixelPacket
from lrm_ident.measuring.servo_bus.kind import Instruction, PacketReader
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from tests.ident.measuring.feetech.test_feetech_servos import SdkPort, held, refusal
from tests.ident.measuring.feetech.test_feetech_servos import line_of as feetech_line_of

pytestmark = pytest.mark.usefixtures("hurried")
ARM = load_arm("so101")
NUMBERS = (1, 2, 3, 4, 5)
BYTES = st.binary(max_size=30) | st.lists(st.sampled_from([0xFF, 0xFD, 0x00]), max_size=30).map(bytes)
PACKETS = st.builds(DynamixelPacket, st.integers(0, 0xFC), st.sampled_from(list(Instruction)).map(int), BYTES)
ANGLES = st.lists(st.floats(-1.5, 1.5), min_size=5, max_size=5)


line_of = partial(feetech_line_of, kind="dynamixel")


@pytest.mark.parametrize(
    ("packet", "expected"),
    [
        # Examples of the e-Manual: ping servo 1; its answer (model 1030, firmware 38); read 4 bytes at 132.
        (DynamixelPacket(1, Instruction.PING), "ff ff fd 00 01 03 00 01 19 4e"),
        (DynamixelPacket(1, Instruction.STATUS, bytes([0, 6, 4, 0x26])), "ff ff fd 00 01 07 00 55 00 06 04 26 65 5d"),
        (DynamixelPacket(1, Instruction.READ, bytes([0x84, 0, 4, 0])), "ff ff fd 00 01 07 00 02 84 00 04 00 1d 15"),
    ],
)
def test_packets_are_those_of_the_manual(packet: DynamixelPacket, expected: str) -> None:
    assert packet.encoded().hex(" ") == expected


@given(st.lists(PACKETS, max_size=5), st.integers(1, 20))
def test_packets_come_back_in_whatever_pieces_they_arrive(packets: list[DynamixelPacket], size: int) -> None:
    stream, reader = b"".join(packet.encoded() for packet in packets), PacketReader(DynamixelPacket)
    pieces = [stream[at : at + size] for at in range(0, len(stream), size)]
    assert [packet for piece in pieces for packet in reader.feed(piece)] == packets


@given(PACKETS)
def test_a_header_stands_at_the_beginning_only(packet: DynamixelPacket) -> None:
    assert packet.encoded().count(DynamixelPacket.HEADER) == 1


@given(PACKETS, st.integers(0, 7), st.data())
def test_a_packet_with_a_flipped_bit_is_none(packet: DynamixelPacket, bit: int, data: st.DataObject) -> None:
    frame = bytearray(packet.encoded())
    frame[data.draw(st.integers(0, len(frame) - 1))] ^= 1 << bit
    assert packet not in list(PacketReader(DynamixelPacket).feed(bytes(frame)))


@pytest.mark.long
@given(ANGLES)
def test_an_arm_goes_where_it_is_sent_with_bounded_torque(goal: list[float]) -> None:
    line = line_of(*NUMBERS)
    arm = ServoArm(held(line), ARM, line, lambda _: None)
    within = [min(max(q, j.lower), j.upper) for q, j in zip(goal, ARM.joints, strict=True)]
    state = arm.go(PlannedPose(1, tuple(within), 0.0, (), 1))
    assert state.q == pytest.approx([servo.target for servo in line.bus.servos])
    assert arm.seen() == pytest.approx(state.q, abs=STEP)
    for servo in line.bus.servos:
        assert isinstance(servo, DynamixelServo)
        assert table.GOAL_PWM.read(servo.control) == round(TORQUE * 885)
    assert 20.0 < arm.temperature() < 40.0


@pytest.mark.parametrize(
    ("register", "value", "words"),
    [
        (table.MODEL, 777, "servo 2 is of model 777; should be XL330-M077"),
        (table.OPERATING_MODE, 4, "servo 2 is in mode 4; should be 3 or 5, which goes to angles"),
    ],
)
def test_another_model_and_another_mode(register: table.Register, value: int, words: str) -> None:
    line = line_of(*NUMBERS)
    servo = line.bus.servos[1]
    assert isinstance(servo, DynamixelServo)
    register.write(servo.control, value)
    assert words in refusal(line)


def test_what_a_servo_refuses_is_said() -> None:
    line = line_of(1)
    host = ServoHost(line, DYNAMIXEL)
    host.write(1, table.TORQUE_ENABLE, 1)
    with pytest.raises(LrmError, match="servo 1 refuses 9 at address 7: not writable now"):
        host.write(1, table.ID, 9)
    with pytest.raises(LrmError, match="servo 1 refuses 900 at address 100: beyond its limit"):
        host.write(1, table.GOAL_PWM, 900)
    assert host.read(1, table.ID) == 1


def test_the_makers_sdk_speaks_with_it() -> None:
    """`dynamixel_sdk`, Robotis's own library, over a port that is this bus."""
    sdk = pytest.importorskip("dynamixel_sdk", reason="dynamixel-sdk is not installed")

    port, handler = SdkPort(line_of(1, 2)), sdk.PacketHandler(2.0)
    assert handler.ping(port, 1) == (1060, sdk.COMM_SUCCESS, 0)
    assert handler.ping(port, 9)[1] == sdk.COMM_RX_TIMEOUT
    assert handler.write1ByteTxRx(port, 2, table.TORQUE_ENABLE.address, 1) == (sdk.COMM_SUCCESS, 0)
    assert handler.write4ByteTxRx(port, 2, table.GOAL_POSITION.address, 0x00FDFFFF)[1] == 6  # stuffed, and refused
    group = sdk.GroupSyncWrite(port, handler, table.GOAL_POSITION.address, 4)
    assert group.addParam(2, [0x00, 0x09, 0x00, 0x00])
    assert group.txPacket() == sdk.COMM_SUCCESS
    port.line.sleep(5.0)
    read = sdk.GroupSyncRead(port, handler, table.POSITION.address, 4)
    assert read.addParam(1)
    assert read.addParam(2)
    assert read.txRxPacket() == sdk.COMM_SUCCESS
    assert [read.getData(number, table.POSITION.address, 4) for number in (1, 2)] == [2048, 0x0900]
