"""Host of a bus of Feetech STS servos: one question at a time over half a duplex line, each answer checked."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from lrm_ident.measuring.feetech import memory_table as table
from lrm_ident.measuring.feetech.memory_table import Register
from lrm_ident.measuring.feetech.packets import BROADCAST, Instruction, Packet, PacketReader

ANSWER_S, LOOK_S = 0.5, 0.1
"""Time (s) for an answer, of a servo that should be there and of one that may; USB adapters hand on every 16 ms."""
ATTEMPTS = 3
"""Of asking a servo that should be there."""


class NoAnswer(ConnectionError):
    """A servo did not answer, or not with a packet."""


class GarbledAnswer(NoAnswer):
    """Bytes came, and they are no packet."""


class SerialLine(Protocol):
    """Part of `serial.Serial` that a bus needs; reads return what came within its timeout."""

    def write(self, data: bytes, /) -> int | None: ...
    def read(self, size: int = 1, /) -> bytes: ...
    def reset_input_buffer(self) -> None: ...
    @property
    def in_waiting(self) -> int: ...


@dataclass(frozen=True, eq=False)
class FeetechHost:
    """Host of the servos at a serial line."""

    line: SerialLine

    def read(self, number: int, register: Register) -> int:
        """Value of a register. Raises `NoAnswer`."""
        return register.read(bytes(register.address) + self._read(number, register.address, register.length))

    def memory(self, number: int) -> bytes:
        """Whole memory of a servo. Two of one number stand at different angles, and garble each other's answers.

        One checksum would still be right for three pairs of angles in a hundred; with the bytes of the angle asked for
        one by one, none is. Raises `NoAnswer`, or `GarbledAnswer`.
        """
        found = b""
        for address, length in ((table.POSITION.address, 1), (table.POSITION.address + 1, 1), (0, table.LAST_READ)):
            found = self._read_patiently(number, address, length)
        return found

    def read_all(self, numbers: Sequence[int], register: Register) -> dict[int, int]:
        """Values of a register of several servos, asked for in one packet. Raises `NoAnswer`."""
        words = bytes([register.address, register.length, *numbers])
        answers = self._heard(Packet(BROADCAST, Instruction.SYNC_READ, words), numbers, ANSWER_S)
        return {number: register.read(bytes(register.address) + answers[number].parameters) for number in numbers}

    def write(self, number: int, register: Register, value: int) -> None:
        """Writes a register, and waits until the servo says so. Raises `NoAnswer`."""
        self._ask(Packet(number, Instruction.WRITE, bytes([register.address]) + _bytes_of(register, value)))

    def move(self, goals: Mapping[int, int]) -> None:
        """Gives servos their goals (counts) by number, all in one packet that nobody answers."""
        goal = table.GOAL_POSITION
        body = b"".join(bytes([number]) + _bytes_of(goal, count) for number, count in goals.items())
        with _line_is_there():
            words = bytes([goal.address, goal.length]) + body
            self.line.write(Packet(BROADCAST, Instruction.SYNC_WRITE, words).encoded())

    def answering(self, numbers: Sequence[int]) -> tuple[int, ...]:
        """Those of these numbers as which one servo answers, or several."""
        return tuple(number for number in numbers if self._answers(number))

    def forget_late_answers(self) -> None:
        """Empties the line. Raises `NoAnswer`: it is gone."""
        with _line_is_there():
            self.line.reset_input_buffer()

    def _answers(self, number: int) -> bool:
        try:
            self._ask(Packet(number, Instruction.PING), LOOK_S)
        except GarbledAnswer:
            return True
        except NoAnswer:
            return False
        return True

    def _read_patiently(self, number: int, address: int, length: int) -> bytes:
        for _ in range(ATTEMPTS - 1):
            try:
                return self._read(number, address, length)
            except NoAnswer:
                continue
        return self._read(number, address, length)

    def _read(self, number: int, address: int, length: int) -> bytes:
        data = self._ask(Packet(number, Instruction.READ, bytes([address, length]))).parameters
        if len(data) != length:
            raise GarbledAnswer(f"servo {number} answers {len(data)} bytes in place of {length}")
        return data

    def _ask(self, question: Packet, patience: float = ANSWER_S) -> Packet:
        """The answer of one servo within a time (s). Raises `NoAnswer`."""
        return self._heard(question, [question.id], patience)[question.id]

    def _heard(self, question: Packet, numbers: Sequence[int], patience: float) -> dict[int, Packet]:
        """Answers of servos within a time (s); an adapter that hands back what was sent is listened through."""
        found: dict[int, Packet] = {}
        self.forget_late_answers()
        with _line_is_there():
            self.line.write(question.encoded())
            reader, heard, end = PacketReader(), b"", time.monotonic() + patience
            while time.monotonic() < end:
                came = self.line.read(max(1, self.line.in_waiting))
                heard += came
                found |= {packet.id: packet for packet in reader.feed(came) if packet != question}
                if all(number in found for number in numbers):
                    return found
        silent = next(number for number in numbers if number not in found)
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


def _bytes_of(register: Register, value: int) -> bytes:
    memory = bytearray(table.SIZE)
    register.write(memory, value)
    return bytes(memory[register.address : register.address + register.length])
