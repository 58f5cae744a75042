"""The simulated Feetech bus: the protocol byte by byte, and servos that do what their registers say."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import LOAD, LOCK, MOVING, SIZE, STEP, STS3215, FeetechServo
from lrm_ident.measuring.servo_bus import feetech as table
from lrm_ident.measuring.servo_bus.feetech import FeetechPacket
from lrm_ident.measuring.servo_bus.kind import BROADCAST, Instruction, PacketReader
from tests.ident.measuring.feetech.test_feetech_servos import SdkPort, line_of

PACKETS = st.builds(FeetechPacket, st.integers(0, 253), st.integers(0, 0x83), st.binary(max_size=40))


def bus_of(*numbers: int) -> FeetechBus:
    return FeetechBus([FeetechServo(number) for number in numbers])


def asked(bus: FeetechBus, number: int, code: int, *parameters: int, now: float = 0.0) -> list[FeetechPacket]:
    """The answers to one instruction."""
    question = FeetechPacket(number, code, bytes(parameters)).encoded()
    return list(PacketReader(FeetechPacket).feed(bus.feed(question, now)))


def write(bus: FeetechBus, number: int, register: table.Register, value: int, now: float = 0.0) -> None:
    memory = bytearray(SIZE)
    register.write(memory, value)
    data = memory[register.address : register.address + register.length]
    assert asked(bus, number, Instruction.WRITE, register.address, *data, now=now) == [FeetechPacket(number, 0)]


def read(bus: FeetechBus, number: int, register: table.Register, now: float = 0.0) -> int:
    (answer,) = asked(bus, number, Instruction.READ, register.address, register.length, now=now)
    return register.read(bytes(register.address) + answer.parameters)


@pytest.mark.parametrize(
    ("packet", "expected"),
    [
        # Examples of the protocol's manual: ping servo 1; read two bytes at 56 of servo 1; write 128 as the id.
        (FeetechPacket(1, Instruction.PING), "ff ff 01 02 01 fb"),
        (FeetechPacket(1, Instruction.READ, bytes([0x38, 2])), "ff ff 01 04 02 38 02 be"),
        (FeetechPacket(0xFE, Instruction.WRITE, bytes([5, 1])), "ff ff fe 04 03 05 01 f4"),
        (FeetechPacket(1, 0, bytes([0x18, 0x05])), "ff ff 01 04 00 18 05 dd"),
    ],
)
def test_bytes_of_the_manual(packet: FeetechPacket, expected: str) -> None:
    assert packet.encoded() == bytes.fromhex(expected)
    assert list(PacketReader(FeetechPacket).feed(bytes.fromhex(expected))) == [packet]


@given(st.lists(PACKETS, max_size=6), st.lists(st.integers(1, 30), max_size=8))
def test_packets_survive_any_cut_of_the_stream(packets: list[FeetechPacket], cuts: list[int]) -> None:
    stream, reader = b"".join(packet.encoded() for packet in packets), PacketReader(FeetechPacket)
    found = list[FeetechPacket]()
    for cut in cuts:
        found += reader.feed(stream[:cut])
        stream = stream[cut:]
    assert [*found, *reader.feed(stream)] == packets


@given(st.binary(max_size=30).filter(lambda noise: b"\xff" not in noise), PACKETS)
def test_noise_before_a_packet_is_skipped(noise: bytes, packet: FeetechPacket) -> None:
    assert list(PacketReader(FeetechPacket).feed(noise + packet.encoded())) == [packet]


@given(PACKETS, st.integers(0, 7), st.data())
def test_a_packet_with_a_flipped_bit_is_none(packet: FeetechPacket, bit: int, data: st.DataObject) -> None:
    frame = bytearray(packet.encoded())
    frame[data.draw(st.integers(4, len(frame) - 1))] ^= 1 << bit
    assert packet not in list(PacketReader(FeetechPacket).feed(bytes(frame)))


@given(st.sampled_from([table.HOMING_OFFSET, table.GOAL_POSITION, LOAD]), st.integers(-40000, 40000))
def test_signed_registers_hold_magnitude_and_sign(register: table.Register, value: int) -> None:
    memory = bytearray(SIZE)
    register.write(memory, value)
    most = (1 << register.sign) - 1 if register.sign is not None else 0
    assert register.read(memory) == max(-most, min(most, value))


def test_ping_answers_and_a_missing_servo_does_not() -> None:
    bus = bus_of(1, 2)
    assert asked(bus, 2, Instruction.PING) == [FeetechPacket(2, 0)]
    assert asked(bus, 3, Instruction.PING) == []
    assert asked(bus, BROADCAST, Instruction.PING) == [FeetechPacket(1, 0), FeetechPacket(2, 0)]
    assert read(bus, 1, table.MODEL) == 777


def test_two_servos_of_one_id_garble_each_other() -> None:
    bus = bus_of(1, 1)
    bus.servos[1].angle = 0.3
    assert asked(bus, 1, Instruction.READ, table.POSITION.address, 2) == []


def test_read_only_registers_stay() -> None:
    bus = bus_of(1)
    before = [read(bus, 1, register) for register in (table.MODEL, table.POSITION, table.TEMPERATURE)]
    for register in (table.MODEL, table.POSITION, table.TEMPERATURE):
        write(bus, 1, register, 77)
    assert [read(bus, 1, register) for register in (table.MODEL, table.POSITION, table.TEMPERATURE)] == before


def test_what_is_written_while_locked_is_lost_with_the_power() -> None:
    bus = bus_of(1)
    write(bus, 1, table.HOMING_OFFSET, -100)
    bus.servos[0].power_cycle()
    assert read(bus, 1, table.HOMING_OFFSET) == 0
    write(bus, 1, LOCK, 0)
    write(bus, 1, table.HOMING_OFFSET, -100)
    bus.servos[0].power_cycle()
    assert read(bus, 1, table.HOMING_OFFSET) == -100
    assert read(bus, 1, table.POSITION) == 2048 + 100


def test_no_shaft_moves_when_torque_comes_and_a_goal_brings_it() -> None:
    bus = bus_of(1)
    servo = bus.servos[0]
    table.GOAL_POSITION.write(servo.memory, 3000)
    bus.advance(5.0)
    write(bus, 1, table.TORQUE_ENABLE, 1, now=5.0)
    bus.advance(10.0)
    assert servo.angle == 0.0
    servo.power_cycle()
    write(bus, 1, table.GOAL_POSITION, 3000, now=10.0)
    bus.advance(15.0)
    assert (servo.powered, servo.angle) == (True, pytest.approx((3000 - 2048) * STEP))


@given(st.integers(0, 4095), st.lists(st.floats(0.001, 0.3), max_size=10))
def test_a_shaft_goes_to_its_goal_no_faster_than_it_can(goal: int, steps: Sequence[float]) -> None:
    bus = bus_of(1)
    servo = bus.servos[0]
    write(bus, 1, table.TORQUE_ENABLE, 1)
    write(bus, 1, table.GOAL_POSITION, goal)
    now, before = 0.0, servo.angle
    for step in steps:
        now += step
        bus.advance(now)
        assert abs(servo.angle - before) <= STS3215.speed * step + 1e-12
        assert (servo.angle - before) * (goal - 2048) >= 0.0
        before = servo.angle
    bus.advance(now + 5.0)
    assert servo.angle == pytest.approx((goal - 2048) * STEP, abs=1e-6)
    assert read(bus, 1, table.POSITION, now + 5.0) == goal
    assert read(bus, 1, MOVING, now + 5.0) == 0


def test_sync_write_and_sync_read_reach_each_its_own() -> None:
    bus = bus_of(1, 2, 3)
    for number in (1, 2, 3):
        write(bus, number, table.TORQUE_ENABLE, 1)
    goals = (1, 0x00, 0x09, 3, 0x00, 0x07)
    assert asked(bus, BROADCAST, Instruction.SYNC_WRITE, table.GOAL_POSITION.address, 2, *goals) == []
    bus.advance(10.0)
    answers = asked(bus, BROADCAST, Instruction.SYNC_READ, table.POSITION.address, 2, 3, 1, 9, 2, now=10.0)
    assert [answer.id for answer in answers] == [3, 1, 2]
    assert [int.from_bytes(answer.parameters, "little") for answer in answers] == [0x0700, 0x0900, 2048]


def test_a_registered_write_waits_for_the_action() -> None:
    bus = bus_of(1)
    write(bus, 1, table.TORQUE_ENABLE, 1)
    assert asked(bus, 1, Instruction.REG_WRITE, table.GOAL_POSITION.address, 0, 9) == [FeetechPacket(1, 0)]
    bus.advance(1.0)
    assert bus.servos[0].angle == 0.0
    asked(bus, BROADCAST, Instruction.ACTION, now=1.0)
    bus.advance(5.0)
    assert bus.servos[0].angle == pytest.approx(256 * STEP, abs=1e-6)


def test_loaded_servos_warm_and_say_so() -> None:
    bus = bus_of(1)
    write(bus, 1, table.TORQUE_ENABLE, 1)
    bus.servos[0].torque = -1.47
    assert read(bus, 1, LOAD) == -500
    bus.advance(3600.0)
    assert read(bus, 1, table.TEMPERATURE, 3600.0) == round(25.0 + STS3215.rise * 1.47**2 * (1 - math.exp(-4.0)))


def test_the_makers_sdk_speaks_with_it() -> None:
    """`scservo_sdk`, the library that LeRobot drives its arms with, over a port that is this bus."""
    scs = pytest.importorskip("scservo_sdk", reason="feetech-servo-sdk is not installed")

    port, handler = SdkPort(line_of(1, 2)), scs.PacketHandler(0)
    assert handler.ping(port, 1) == (777, scs.COMM_SUCCESS, 0)
    assert handler.ping(port, 9)[1] == scs.COMM_RX_TIMEOUT
    assert handler.write2ByteTxRx(port, 2, table.MAX_TORQUE.address, 500) == (scs.COMM_SUCCESS, 0)
    assert handler.read2ByteTxRx(port, 2, table.MAX_TORQUE.address) == (500, scs.COMM_SUCCESS, 0)
    group = scs.GroupSyncRead(port, handler, table.POSITION.address, 2)
    assert group.addParam(1)
    assert group.addParam(2)
    assert group.txRxPacket() == scs.COMM_SUCCESS
    assert [group.getData(number, table.POSITION.address, 2) for number in (1, 2)] == [2048, 2048]


@given(steps=st.lists(st.floats(0.001, 0.1), max_size=20))
def test_a_servo_acts_on_a_goal_after_the_dead_time_however_time_is_cut(steps: list[float]) -> None:
    late, prompt = FeetechBus([FeetechServo(1)], dead_time=0.25), bus_of(1)
    for bus, begun in ((late, 0.0), (prompt, 0.25)):
        write(bus, 1, table.GOAL_POSITION, 2148, now=begun)
    assert late.moving
    assert not late.servos[0].moving
    now = 0.0
    for step in steps:
        late.advance(now := now + step)
        assert (late.servos[0].angle > 0.0) == (now > 0.25)
    for bus in (late, prompt):
        bus.advance(2.0 + now)
    assert late.servos[0].angle == pytest.approx(prompt.servos[0].angle, abs=1e-9)
    assert not late.moving


def test_only_goals_are_acted_on_late() -> None:
    bus = FeetechBus([FeetechServo(1)], dead_time=0.25)
    write(bus, 1, table.TORQUE_ENABLE, 1)
    assert read(bus, 1, table.TORQUE_ENABLE) == 1
