"""Host of a bus of servos: one question at a time over half a duplex line, each answer checked."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

from lrm_ident.measuring.servo_bus.kind import (
    BROADCAST,
    Answer,
    BusServoKind,
    Instruction,
    Packet,
    PacketReader,
    Register,
)
from lrm_math.errors import LrmError

ANSWER_S, LOOK_S = 0.5, 0.1
"""Time (s) for an answer, of a servo that should be there and of one that may; USB adapters hand on every 16 ms."""
ATTEMPTS = 3
"""Number of times that a servo is asked which should be there."""
Said = TypeVar("Said")


class NoAnswer(ConnectionError):
    """A servo did not answer, or not with a packet."""


class GarbledAnswer(NoAnswer):
    """Bytes came, and they are no packet."""


class SerialLine(Protocol):
    """Part of `serial.Serial` that a bus needs; reads return what came within its timeout."""

    def write(self, data: bytes, /) -> int | None: ...
    def read(self, size: int = 1, /) -> bytes: ...
    @property
    def in_waiting(self) -> int: ...


@dataclass(frozen=True, eq=False)
class ServoHost:
    """Host of the servos of a kind at a serial line."""

    line: SerialLine
    kind: BusServoKind

    def read(self, number: int, register: Register) -> int:
        """Value of a register. Raises `NoAnswer`."""
        return register.decoded(self._read(number, register.address, register.length))

    def read_with_retries(self, number: int, register: Register) -> int:
        """Value of a register, asked for again where no answer came. Raises `NoAnswer`."""
        return _with_retries(partial(self.read, number, register))

    def memory(self, number: int) -> bytes:
        """Whole memory of a servo. Two of one number stand at different angles, and garble each other's answers.

        One checksum would still be right for three pairs of angles in a hundred; with the bytes of the angle asked for
        one by one, none is. Raises `NoAnswer`, or `GarbledAnswer`.
        """
        read = b""
        at = self.kind.position.address
        for address, length in ((at, 1), (at + 1, 1), (0, self.kind.last_read)):
            read = _with_retries(partial(self._read, number, address, length))
        return read

    def read_all(self, numbers: Sequence[int], register: Register) -> dict[int, int]:
        """Values of a register of several servos, asked for in one packet. Raises `NoAnswer`."""
        parameters = self.kind.packet.words(register.address, register.length) + bytes(numbers)
        question = self.kind.packet(BROADCAST, Instruction.SYNC_READ, parameters)
        answers = self._heard(question, numbers, ANSWER_S)
        return {number: register.decoded(_of_length(answers[number], register.length)) for number in numbers}

    def write(self, number: int, register: Register, value: int) -> None:
        """Writes a register, and waits until the servo says so. Raises `NoAnswer`; `LrmError`: it refuses.

        An answer with data is none to a write: it is a late one to a question before.
        """
        parameters = self.kind.packet.words(register.address) + register.encoded(value)
        answer = self._transfer(number, Instruction.WRITE, parameters)
        if answer.refused:
            raise LrmError(f"servo {number} refuses {value} at address {register.address}: {answer.refused}")
        _of_length(answer, 0)

    def write_with_retries(self, number: int, register: Register, value: int) -> None:
        """Writes a register, and again where no answer came. Raises as `write` does."""
        _with_retries(partial(self.write, number, register, value))

    def move(self, goals: Mapping[int, int]) -> None:
        """Gives servos their goals (counts) by number, all in one packet that nobody answers."""
        goal = self.kind.goal
        data = b"".join(bytes([number]) + goal.encoded(count) for number, count in goals.items())
        parameters = self.kind.packet.words(goal.address, goal.length) + data
        with _line_is_there():
            self.line.write(self.kind.packet(BROADCAST, Instruction.SYNC_WRITE, parameters).encoded())

    def answering(self, numbers: Sequence[int]) -> tuple[int, ...]:
        """Those of these numbers as which one servo answers, or several."""
        return tuple(number for number in numbers if self._answers(number))

    def forget_late_answers(self) -> None:
        """Empties the line. Raises `NoAnswer`: it is gone."""
        with _line_is_there():
            self.line.read(self.line.in_waiting)

    def _answers(self, number: int) -> bool:
        try:
            self._transfer(number, Instruction.PING, b"", LOOK_S)
        except NoAnswer as error:
            return isinstance(error, GarbledAnswer)
        return True

    def _read(self, number: int, address: int, length: int) -> bytes:
        return _of_length(self._transfer(number, Instruction.READ, self.kind.packet.words(address, length)), length)

    def _transfer(self, number: int, what: Instruction, parameters: bytes, patience: float = ANSWER_S) -> Answer:
        """The answer of one servo within a time (s). Raises `NoAnswer`."""
        return self._heard(self.kind.packet(number, what, parameters), [number], patience)[number]

    def _heard(self, question: Packet, numbers: Sequence[int], patience: float) -> dict[int, Answer]:
        """Answers of servos within a time (s); an adapter that hands back what was sent is listened through."""
        answers_by_id: dict[int, Answer] = {}
        self.forget_late_answers()
        with _line_is_there():
            self.line.write(question.encoded())
            reader, heard, end = PacketReader(self.kind.packet), b"", time.monotonic() + patience
            while time.monotonic() < end:
                came = self.line.read(max(1, self.line.in_waiting))
                heard += came
                answers = [packet.answer for packet in reader.feed(came) if packet != question]
                answers_by_id |= {answer.id: answer for answer in answers if answer is not None}
                if all(number in answers_by_id for number in numbers):
                    return answers_by_id
        silent = next(number for number in numbers if number not in answers_by_id)
        if heard.removeprefix(question.encoded()):
            raise GarbledAnswer(f"the answer of servo {silent} is garbled")
        raise NoAnswer(f"servo {silent} does not answer")


@contextmanager
def _line_is_there() -> Iterator[None]:
    """Raises `NoAnswer` where the adapter was unplugged."""
    try:
        yield
    except NoAnswer:
        raise
    except OSError as error:
        raise NoAnswer(f"the serial line is gone ({' '.join(str(error).split())})") from None


def _of_length(answer: Answer, length: int) -> bytes:
    """The data of an answer. Raises `GarbledAnswer`: another number of bytes, so it answers another question."""
    if len(answer.data) != length:
        raise GarbledAnswer(f"servo {answer.id} answers {len(answer.data)} bytes in place of {length}")
    return answer.data


def _with_retries(request: Callable[[], Said]) -> Said:
    """Sends a request again where no answer came. Raises `NoAnswer`."""
    for _ in range(ATTEMPTS - 1):
        try:
            return request()
        except NoAnswer:
            continue
    return request()
