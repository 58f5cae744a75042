"""Answers of servos that come after their time, on a real pty: what is asked next is not answered by them."""

from __future__ import annotations

import os
import pty
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import pytest
import serial

from lrm_ident.measuring.servo_bus.bus import NoAnswer, ServoHost
from lrm_ident.measuring.servo_bus.dynamixel import DYNAMIXEL, DynamixelPacket
from lrm_ident.measuring.servo_bus.feetech import FEETECH, FeetechPacket
from lrm_ident.measuring.servo_bus.kind import BusServoKind, Instruction

KINDS = (FEETECH, DYNAMIXEL)
LATE, FRESH = 1111, 2222


def status(kind: BusServoKind, number: int, data: bytes = b"") -> bytes:
    """Answer of a servo."""
    if kind is FEETECH:
        return FeetechPacket(number, 0, data).encoded()
    return DynamixelPacket(number, Instruction.STATUS, b"\0" + data).encoded()


@contextmanager
def host_of(kind: BusServoKind, before: bytes, answers: Sequence[bytes]) -> Iterator[ServoHost]:
    """A host whose line holds bytes before anything is asked; the far end answers one question after the other."""
    far, near = pty.openpty()

    def answer() -> None:
        for one in answers:
            os.read(far, 256)
            os.write(far, one)

    with serial.Serial(os.ttyname(near), 1_000_000, timeout=0.01) as line:
        os.write(far, before)
        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        yield ServoHost(line, kind)
        thread.join(5.0)
        assert not thread.is_alive(), "not everything was asked"
    os.close(near)
    os.close(far)


def position(kind: BusServoKind, count: int, number: int = 1) -> bytes:
    return status(kind, number, kind.position.encoded(count))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("read", [ServoHost.read, ServoHost.read_with_retries])
def test_what_came_before_the_question_is_dropped(
    kind: BusServoKind, read: Callable[[ServoHost, int, object], int]
) -> None:
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
    with host_of(kind, b"", [b"", position(kind, FRESH)]) as host:
        with pytest.raises(NoAnswer):
            host.read(1, kind.goal)
        assert host.read(1, kind.position) == FRESH
