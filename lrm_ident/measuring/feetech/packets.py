"""Packets of the Feetech STS protocol: FF FF, id, length, instruction or error, parameters, checksum.

The length counts what follows it; the checksum is the complement of the sum of all bytes between header and itself
(Feetech, "Communication protocol user manual"; the same frame as Dynamixel's protocol 1).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

HEADER = b"\xff\xff"
BROADCAST = 0xFE
SHORTEST = 2
"""Least length: an instruction or error, and the checksum."""
LONGEST = 250


class Instruction(IntEnum):
    """What a host asks for."""

    PING = 1
    READ = 2
    WRITE = 3
    REG_WRITE = 4
    ACTION = 5
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83


@dataclass(frozen=True)
class Packet:
    """One packet. `code`: the instruction of a host's, the error flags of a servo's."""

    id: int
    code: int
    parameters: bytes = b""

    def encoded(self) -> bytes:
        """Its bytes."""
        body = bytes([self.id, len(self.parameters) + SHORTEST, self.code]) + self.parameters
        return HEADER + body + bytes([checksum(body)])


def checksum(body: bytes) -> int:
    """Of the bytes from the id to the last parameter."""
    return ~sum(body) & 0xFF


class PacketReader:
    """Finds packets in a stream of bytes; what is none is skipped."""

    def __init__(self) -> None:
        self._left = b""

    def feed(self, data: bytes) -> Iterator[Packet]:
        """The packets that are complete with these bytes."""
        self._left += data
        while (packet := self._next()) is not None:
            yield packet

    def _next(self) -> Packet | None:
        while True:
            start = self._left.find(HEADER)
            if start < 0:
                self._left = self._left[-1:] if self._left.endswith(b"\xff") else b""
                return None
            self._left = self._left[start:]
            if len(self._left) < 4:
                return None
            length = self._left[3]
            if self._left[2] == 0xFF or not SHORTEST <= length <= LONGEST:
                self._left = self._left[1:]
                continue
            end = 4 + length
            if len(self._left) < end:
                return None
            frame, body = self._left[:end], self._left[2 : end - 1]
            if frame[-1] != checksum(body):
                self._left = self._left[1:]
                continue
            self._left = self._left[end:]
            return Packet(frame[2], frame[4], frame[5:-1])
