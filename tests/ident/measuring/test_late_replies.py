"""Answers of servos that come late or never, on a real pty: what is asked next is not answered by them."""

from __future__ import annotations

import os
import pty
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace

import pytest
import serial

from lrm_ident.measuring.campaign.lerobot_robot import LeRobotServos
from lrm_ident.measuring.campaign.servo_arm import ServoArm, Servos
from lrm_ident.measuring.servo_bus import feetech as table
from lrm_ident.measuring.servo_bus.bus import NoAnswer, ServoHost
from lrm_ident.measuring.servo_bus.dynamixel import DYNAMIXEL, DynamixelPacket
from lrm_ident.measuring.servo_bus.feetech import FEETECH, FeetechPacket
from lrm_ident.measuring.servo_bus.kind import BusServoKind, Instruction
from lrm_ident.measuring.servo_bus.servos import BusServos
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from tests.support.simulated_clock import SimulatedClock

KINDS = (FEETECH, DYNAMIXEL)
LATE, FRESH = 1111, 2222


def status(kind: BusServoKind, number: int, data: bytes = b"") -> bytes:
    """Answer of a servo."""
    if kind is FEETECH:
        return FeetechPacket(number, 0, data).encoded()
    return DynamixelPacket(number, Instruction.STATUS, b"\0" + data).encoded()


@dataclass(frozen=True)
class FarEnd:
    """The servos' end of a line whose other end a host has."""

    descriptor: int
    line: serial.Serial

    def sends_unasked(self, data: bytes) -> None:
        """Bytes that lie in the host's line before it asks again; the kernel takes its time to pass them on."""
        os.write(self.descriptor, data)
        deadline = time.monotonic() + 5.0
        while self.line.in_waiting < len(data):
            assert time.monotonic() < deadline, "the kernel did not pass the bytes on"
            time.sleep(0.001)

    @contextmanager
    def answering(self, answers: Sequence[bytes]) -> Iterator[None]:
        """One answer to each question."""

        def answer() -> None:
            for one in answers:
                os.read(self.descriptor, 256)
                os.write(self.descriptor, one)

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        yield
        thread.join(5.0)
        assert not thread.is_alive(), "not everything was asked"


@contextmanager
def ends_of(kind: BusServoKind) -> Iterator[tuple[ServoHost, FarEnd]]:
    """A host and the far end of its line."""
    far, near = pty.openpty()
    with serial.Serial(os.ttyname(near), 1_000_000, timeout=0.2) as line:
        yield ServoHost(line, kind), FarEnd(far, line)
    os.close(near)
    os.close(far)


@contextmanager
def host_of(kind: BusServoKind, before: bytes, answers: Sequence[bytes]) -> Iterator[ServoHost]:
    """A host whose line holds bytes before anything is asked; the far end answers one question after the other."""
    with ends_of(kind) as (host, far):
        far.sends_unasked(before)
        with far.answering(answers):
            yield host


def position(kind: BusServoKind, count: int, number: int = 1) -> bytes:
    return status(kind, number, kind.position.encoded(count))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("read", [ServoHost.read, ServoHost.read_with_retries])
def test_what_came_before_is_dropped(kind: BusServoKind, read: Callable[[ServoHost, int, object], int]) -> None:
    with host_of(kind, position(kind, LATE), [position(kind, FRESH)]) as host:
        assert read(host, 1, kind.position) == FRESH


@pytest.mark.parametrize("kind", KINDS)
def test_what_came_before_a_question_to_several_is_dropped(kind: BusServoKind) -> None:
    late = position(kind, LATE) + position(kind, LATE, 2)
    with host_of(kind, late, [position(kind, FRESH) + position(kind, FRESH + 1, 2)]) as host:
        assert host.read_all([1, 2], kind.position) == {1: FRESH, 2: FRESH + 1}


@pytest.mark.parametrize("kind", KINDS)
def test_a_late_answer_of_another_servo_is_none(kind: BusServoKind) -> None:
    """It comes after the next question."""
    with host_of(kind, b"", [position(kind, LATE, 2) + position(kind, FRESH)]) as host:
        assert host.read(1, kind.position) == FRESH


@pytest.mark.parametrize("kind", KINDS)
def test_a_late_answer_of_another_length_is_asked_for_again(kind: BusServoKind) -> None:
    """The angle comes after the temperature was asked for: it is no temperature."""
    with host_of(kind, b"", [position(kind, LATE), status(kind, 1, b"\x2a")]) as host:
        assert host.read_with_retries(1, kind.temperature) == 0x2A


@pytest.mark.parametrize("kind", KINDS)
def test_late_answers_of_another_length_are_none_of_several(kind: BusServoKind) -> None:
    answers = [status(kind, 1, b"\x2a") + position(kind, FRESH, 2)]
    with host_of(kind, b"", answers) as host, pytest.raises(NoAnswer, match="servo 1 answers 1 bytes"):
        host.read_all([1, 2], kind.position)


@pytest.mark.parametrize("kind", KINDS)
def test_a_late_reading_does_not_confirm_a_write(kind: BusServoKind) -> None:
    with host_of(kind, b"", [position(kind, LATE), status(kind, 1)]) as host:
        host.write_with_retries(1, kind.torque, 1)
    with host_of(kind, b"", [position(kind, LATE)]) as host, pytest.raises(NoAnswer, match="bytes in place of 0"):
        host.write(1, kind.torque, 1)


@pytest.mark.parametrize("kind", KINDS)
def test_an_answer_that_came_after_its_time_is_not_the_next_ones(kind: BusServoKind) -> None:
    """Nobody answers in time; the answer is in the line when the other register of this length is asked for."""
    with ends_of(kind) as (host, far):
        with pytest.raises(NoAnswer):
            host.read(1, kind.goal)
        os.read(far.descriptor, 256)
        far.sends_unasked(position(kind, LATE))
        with far.answering([position(kind, FRESH)]):
            assert host.read(1, kind.position) == FRESH


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
def test_silent_servos_are_one_line(unplugged: serial.Serial, servos_of: Callable[[serial.Serial], Servos]) -> None:
    servos = servos_of(unplugged)
    with pytest.raises(LrmError, match=r"^[^\n]+ does not answer: [^\n]+$"):
        ServoArm(servos, ARM, SimulatedClock(), lambda _: None)
