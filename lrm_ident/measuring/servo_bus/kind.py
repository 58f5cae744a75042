"""Facts that a bus has to know of a kind of servos: how their packets are written, and which registers do what.

Packets are header, id, length, instruction or error, parameters, checksum; the length counts what follows it. Registers
are numbers in the memory of a servo. All numbers have their low byte first.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
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


@dataclass(frozen=True)
class Register:
    """A number of one or two bytes. `sign`: the bit that makes it negative; None: unsigned."""

    address: int
    length: int = 1
    sign: int | None = None

    def read(self, memory: bytes | bytearray) -> int:
        """Value of the register."""
        return self.decoded(memory[self.address : self.address + self.length])

    def write(self, memory: bytearray, value: int) -> None:
        """Puts a value there, cut to what it can hold."""
        memory[self.address : self.address + self.length] = self.encoded(value)

    def decoded(self, data: bytes | bytearray) -> int:
        """Value of its bytes."""
        raw = int.from_bytes(data, "little")
        if self.sign is None:
            return raw
        size = raw & ~(1 << self.sign)
        return -size if raw >> self.sign & 1 else size

    def encoded(self, value: int) -> bytes:
        """Bytes of a value, cut to what it can hold."""
        most = (1 << (8 * self.length if self.sign is None else self.sign)) - 1
        size = min(abs(value), most)
        raw = size | 1 << self.sign if self.sign is not None and value < 0 else size
        return raw.to_bytes(self.length, "little")


class TwosComplement(Register):
    """A signed number as two's complement."""

    def decoded(self, data: bytes | bytearray) -> int:
        """See `Register`."""
        return int.from_bytes(data, "little", signed=True)

    def encoded(self, value: int) -> bytes:
        """See `Register`."""
        half = 1 << (8 * self.length - 1)
        return min(max(value, -half), half - 1).to_bytes(self.length, "little", signed=True)


@dataclass(frozen=True)
class BusServoKind:
    """A kind of servos of 4096 counts a turn.

    Attributes:
        prefix: of its name in `--robot`. baud: usual bits per second. models: names by model number.
        modes: those that go to angles. last_read: registers below say all of a servo's settings and state.
        settings: registers of what belongs to a measurement, by the fields of `JointServoSettings`, and the factor of
            each. firmware: those of its version, the major number first.
        limit: register that bounds its torque until it is switched on anew; most: that of its greatest value.
    """

    prefix: str
    packet: type[Packet]
    models: Mapping[int, str]
    modes: tuple[int, ...]
    last_read: int
    model: Register
    mode: Register
    least: Register
    greatest: Register
    torque: Register
    goal: Register
    position: Register
    temperature: Register
    limit: Register
    most: Register
    settings: Mapping[str, tuple[Register, int]]
    firmware: tuple[Register, ...]
    baud: int = 1_000_000
