"""Host of a bus of Feetech STS servos: one question at a time over half a duplex line, each answer checked."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from lrm_ident.measuring.feetech import memory_table as table
from lrm_ident.measuring.feetech.memory_table import Register
from lrm_ident.measuring.feetech.packets import BROADCAST, Instruction, Packet, PacketReader

ANSWER_S = 0.1
"""Time for an answer; USB adapters hand bytes on every 16 ms."""


class NoAnswer(ConnectionError):
    """A servo did not answer, or not with a packet."""


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

    def ping(self, number: int) -> None:
        """Asks for a sign of life. Raises `NoAnswer`."""
        self._ask(Packet(number, Instruction.PING))

    def read(self, number: int, register: Register) -> int:
        """Value of a register. Raises `NoAnswer`."""
        data = self._ask(Packet(number, Instruction.READ, bytes([register.address, register.length]))).parameters
        if len(data) != register.length:
            raise NoAnswer(f"servo {number} answers {len(data)} bytes for {register.length}")
        return register.read(bytes(register.address) + data)

    def write(self, number: int, register: Register, value: int) -> None:
        """Writes a register, and waits until the servo says so. Raises `NoAnswer`."""
        self._ask(Packet(number, Instruction.WRITE, bytes([register.address]) + _bytes_of(register, value)))

    def move(self, goals: Mapping[int, int]) -> None:
        """Gives servos their goals (counts) by number, all in one packet that nobody answers."""
        goal = table.GOAL_POSITION
        body = b"".join(bytes([number]) + _bytes_of(goal, count) for number, count in goals.items())
        self.line.write(Packet(BROADCAST, Instruction.SYNC_WRITE, bytes([goal.address, goal.length]) + body).encoded())

    def answering(self, numbers: Sequence[int]) -> dict[int, str]:
        """For each of these numbers why no servo answers as it, empty if one does."""
        found = {}
        for number in numbers:
            try:
                self.ping(number)
                found[number] = ""
            except NoAnswer as error:
                found[number] = str(error)
        return found

    def forget_late_answers(self) -> None:
        """Empties the line."""
        self.line.reset_input_buffer()

    def _ask(self, question: Packet) -> Packet:
        """The answer of one servo; an adapter that hands back what was sent is listened through."""
        self.forget_late_answers()
        self.line.write(question.encoded())
        reader, heard, end = PacketReader(), b"", time.monotonic() + ANSWER_S
        while True:
            came = self.line.read(max(1, self.line.in_waiting))
            heard += came
            for packet in reader.feed(came):
                if packet.id == question.id and packet != question:
                    return packet
            if time.monotonic() > end:
                rest = heard.removeprefix(question.encoded())
                what = "answers no packet: are there two servos of this number?" if rest else "does not answer"
                raise NoAnswer(f"servo {question.id} {what}")


def _bytes_of(register: Register, value: int) -> bytes:
    memory = bytearray(table.SIZE)
    register.write(memory, value)
    return bytes(memory[register.address : register.address + register.length])
