"""Dynamixel X servos as a bus knows them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from lrm_ident.measuring.dynamixel import memory_table as table
from lrm_ident.measuring.dynamixel.packets import BROADCAST, Instruction2, Packet2, PacketReader2
from lrm_ident.measuring.servo_bus.contract import Answer, BusServoKind

ALERT = 0x80
"""Bit of the error of a servo that has shut down, or is about to; the others are of the question."""
ERRORS = {
    1: "it failed", 2: "unknown instruction", 3: "wrong CRC", 4: "out of range", 5: "wrong length",
    6: "beyond its limit", 7: "not writable now",
}  # fmt: skip


class DynamixelProtocol:
    """See `BusProtocol`."""

    def ping(self, number: int) -> bytes:
        """See `BusProtocol`."""
        return Packet2(number, Instruction2.PING).encoded()

    def read(self, number: int, address: int, length: int) -> bytes:
        """See `BusProtocol`."""
        return Packet2(number, Instruction2.READ, _words(address, length)).encoded()

    def read_all(self, numbers: Sequence[int], address: int, length: int) -> bytes:
        """See `BusProtocol`."""
        return Packet2(BROADCAST, Instruction2.SYNC_READ, _words(address, length) + bytes(numbers)).encoded()

    def write(self, number: int, address: int, data: bytes) -> bytes:
        """See `BusProtocol`."""
        return Packet2(number, Instruction2.WRITE, _words(address) + data).encoded()

    def write_all(self, address: int, data: Mapping[int, bytes]) -> bytes:
        """See `BusProtocol`."""
        length = len(next(iter(data.values())))
        body = b"".join(bytes([number]) + one for number, one in data.items())
        return Packet2(BROADCAST, Instruction2.SYNC_WRITE, _words(address, length) + body).encoded()

    def answers(self, question: bytes) -> DynamixelAnswers:
        """See `BusProtocol`; only a status is an answer, so that an echo is none."""
        return DynamixelAnswers()


@dataclass
class DynamixelAnswers:
    """See `AnswerReader`."""

    _reader: PacketReader2 = field(default_factory=PacketReader2)

    def feed(self, data: bytes) -> Iterator[Answer]:
        """See `AnswerReader`."""
        for packet in self._reader.feed(data):
            if packet.code == Instruction2.STATUS and packet.parameters:
                error = packet.parameters[0] & ~ALERT
                yield Answer(packet.id, packet.parameters[1:], ERRORS.get(error, f"error {error}") if error else "")


def _words(*numbers: int) -> bytes:
    return b"".join(number.to_bytes(2, "little") for number in numbers)


DYNAMIXEL = BusServoKind(
    prefix="dynamixel:",
    protocol=DynamixelProtocol(),
    baud=1_000_000,
    models=table.MODELS,
    modes=(table.POSITION_MODE, table.CURRENT_POSITION_MODE),
    last_read=table.SIZE,
    model=table.MODEL,
    mode=table.OPERATING_MODE,
    least=table.MIN_POSITION,
    greatest=table.MAX_POSITION,
    torque=table.TORQUE_ENABLE,
    goal=table.GOAL_POSITION,
    position=table.POSITION,
    temperature=table.TEMPERATURE,
    limit=table.GOAL_PWM,
    most=table.PWM_LIMIT,
)
