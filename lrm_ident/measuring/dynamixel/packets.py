"""Packets of Dynamixel's protocol 2.0: FF FF FD 00, id, length, instruction, parameters, CRC-16.

The length (two bytes, low first) counts what follows it. Wherever FF FF FD stands in instruction and parameters, an
FD is stuffed behind it, so that a header is one. The CRC (polynomial 8005, from 0, high bit first) is of all bytes
before it (Robotis, e-Manual, "DYNAMIXEL Protocol 2.0").
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

HEADER, STUFFED = b"\xff\xff\xfd\x00", b"\xff\xff\xfd"
BROADCAST = 0xFE
SHORTEST, LONGEST = 3, 1024
"""Least and greatest length: an instruction and the CRC, and what fits a servo's buffer."""
POLYNOMIAL = 0x8005


class Instruction2(IntEnum):
    """What a host asks for, and what a servo answers with."""

    PING = 1
    READ = 2
    WRITE = 3
    REG_WRITE = 4
    ACTION = 5
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83


@dataclass(frozen=True)
class Packet2:
    """One packet. The first parameter of a status is its error."""

    id: int
    code: int
    parameters: bytes = b""

    def encoded(self) -> bytes:
        """Its bytes."""
        body = (bytes([self.code]) + self.parameters).replace(STUFFED, STUFFED + b"\xfd")
        whole = HEADER + bytes([self.id]) + (len(body) + 2).to_bytes(2, "little") + body
        return whole + crc16(whole).to_bytes(2, "little")


def crc16(data: bytes) -> int:
    """CRC-16 of bytes."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ POLYNOMIAL if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


class PacketReader2:
    """Finds packets in a stream of bytes; what is none is skipped."""

    def __init__(self) -> None:
        self._left = b""

    def feed(self, data: bytes) -> Iterator[Packet2]:
        """The packets that are complete with these bytes."""
        self._left += data
        while (packet := self._next()) is not None:
            yield packet

    def _next(self) -> Packet2 | None:
        while (start := self._left.find(HEADER)) >= 0:
            self._left = self._left[start:]
            if len(self._left) < 7:
                return None
            length = int.from_bytes(self._left[5:7], "little")
            end = 7 + length
            if SHORTEST <= length <= LONGEST:
                if len(self._left) < end:
                    return None
                frame = self._left[:end]
                if int.from_bytes(frame[-2:], "little") == crc16(frame[:-2]):
                    self._left = self._left[end:]
                    body = frame[7:-2].replace(STUFFED + b"\xfd", STUFFED)
                    return Packet2(frame[4], body[0], body[1:])
            self._left = self._left[1:]
        self._left = self._left[-3:]
        return None
