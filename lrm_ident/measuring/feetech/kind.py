"""Feetech STS servos as a bus knows them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from lrm_ident.measuring.feetech import memory_table as table
from lrm_ident.measuring.feetech.packets import BROADCAST, Instruction, Packet, PacketReader
from lrm_ident.measuring.servo_bus.contract import Answer, BusServoKind


class FeetechProtocol:
    """See `BusProtocol`."""

    def ping(self, number: int) -> bytes:
        """See `BusProtocol`."""
        return Packet(number, Instruction.PING).encoded()

    def read(self, number: int, address: int, length: int) -> bytes:
        """See `BusProtocol`."""
        return Packet(number, Instruction.READ, bytes([address, length])).encoded()

    def read_all(self, numbers: Sequence[int], address: int, length: int) -> bytes:
        """See `BusProtocol`."""
        return Packet(BROADCAST, Instruction.SYNC_READ, bytes([address, length, *numbers])).encoded()

    def write(self, number: int, address: int, data: bytes) -> bytes:
        """See `BusProtocol`."""
        return Packet(number, Instruction.WRITE, bytes([address]) + data).encoded()

    def write_all(self, address: int, data: Mapping[int, bytes]) -> bytes:
        """See `BusProtocol`."""
        length = len(next(iter(data.values())))
        body = b"".join(bytes([number]) + one for number, one in data.items())
        return Packet(BROADCAST, Instruction.SYNC_WRITE, bytes([address, length]) + body).encoded()

    def answers(self, question: bytes) -> FeetechAnswers:
        """See `BusProtocol`."""
        return FeetechAnswers(question)


@dataclass
class FeetechAnswers:
    """See `AnswerReader`; packets of host and servo look alike, so that an echo is known by its bytes."""

    question: bytes
    _reader: PacketReader = field(default_factory=PacketReader)

    def feed(self, data: bytes) -> Iterator[Answer]:
        """See `AnswerReader`."""
        for packet in self._reader.feed(data):
            if packet.encoded() != self.question:
                yield Answer(packet.id, packet.parameters)


FEETECH = BusServoKind(
    prefix="feetech:",
    protocol=FeetechProtocol(),
    baud=1_000_000,
    models={table.MODEL_STS3215: "STS3215", table.MODEL_STS3250: "STS3250"},
    modes=(0,),
    last_read=table.LAST_READ,
    model=table.MODEL,
    mode=table.MODE,
    least=table.MIN_POSITION,
    greatest=table.MAX_POSITION,
    torque=table.TORQUE_ENABLE,
    goal=table.GOAL_POSITION,
    position=table.POSITION,
    temperature=table.TEMPERATURE,
    limit=table.TORQUE_LIMIT,
    most=table.MAX_TORQUE,
)
