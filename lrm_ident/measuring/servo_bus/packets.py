"""Packets on a bus of servos: header, id, length, instruction or error, parameters, checksum.

The length counts what follows it; all numbers have their low byte first.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar, Generic, Self, TypeVar

BROADCAST = 0xFE


class Instruction(IntEnum):
    """Requests of a host; STATUS is what a servo answers with in Dynamixel's protocol 2.0."""

    PING = 1
    READ = 2
    WRITE = 3
    REG_WRITE = 4
    ACTION = 5
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83


@dataclass(frozen=True)
class Answer:
    """Answer of one servo. `refused`: why it did not do as told, in words; empty: it did."""

    id: int
    data: bytes = b""
    refused: str = ""


@dataclass(frozen=True)
class Packet(ABC):
    """One packet of a protocol.

    `WORD`: bytes of an address, of a length and of the checksum. `LONGEST`: greatest length.
    """

    HEADER: ClassVar[bytes]
    WORD: ClassVar[int]
    LONGEST: ClassVar[int]

    id: int
    code: int
    parameters: bytes = b""

    @staticmethod
    @abstractmethod
    def checksum(before: bytes) -> int:
        """Checksum of all bytes before it."""

    @property
    @abstractmethod
    def answer(self) -> Answer | None:
        """The answer that it is; None if it is no servo's."""

    @classmethod
    def words(cls, *numbers: int) -> bytes:
        """Addresses and lengths as parameters."""
        return b"".join(number.to_bytes(cls.WORD, "little") for number in numbers)

    def encoded(self) -> bytes:
        """Bytes of the packet."""
        body = self.stuffed(bytes([self.code]) + self.parameters)
        whole = self.HEADER + bytes([self.id]) + self.words(len(body) + self.WORD) + body
        return whole + self.words(self.checksum(whole))

    @classmethod
    def decoded(cls, whole: bytes) -> Self | None:
        """The packet of all of its bytes; None if they are none."""
        head = len(cls.HEADER)
        if whole[head] > BROADCAST or whole[-cls.WORD :] != cls.words(cls.checksum(whole[: -cls.WORD])):
            return None
        body = cls.unstuffed(whole[head + 1 + cls.WORD : -cls.WORD])
        return cls(whole[head], body[0], body[1:])

    @staticmethod
    def stuffed(body: bytes) -> bytes:
        """Instruction and parameters such that no header stands in them."""
        return body

    @staticmethod
    def unstuffed(body: bytes) -> bytes:
        """The inverse of `stuffed`."""
        return body


AnyPacket = TypeVar("AnyPacket", bound=Packet)


class PacketReader(Generic[AnyPacket]):
    """Finds packets of a kind in a stream of bytes; what is none is skipped."""

    def __init__(self, kind: type[AnyPacket]) -> None:
        self._kind, self._left = kind, b""

    def feed(self, data: bytes) -> Iterator[AnyPacket]:
        """The packets that are complete with these bytes."""
        self._left += data
        while (packet := self._next()) is not None:
            yield packet

    def _next(self) -> AnyPacket | None:
        kind = self._kind
        head = len(kind.HEADER) + 1 + kind.WORD
        while (start := self._left.find(kind.HEADER)) >= 0:
            self._left = self._left[start:]
            if len(self._left) < head:
                return None
            length = int.from_bytes(self._left[head - kind.WORD : head], "little")
            if kind.WORD < length <= kind.LONGEST:  # an instruction or error at least, and the checksum
                if len(self._left) < head + length:
                    return None
                if (packet := kind.decoded(self._left[: head + length])) is not None:
                    self._left = self._left[head + length :]
                    return packet
            self._left = self._left[1:]
        self._left = self._left[1 - len(kind.HEADER) :]
        return None
