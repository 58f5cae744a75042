"""What a bus has to know of a kind of servos: how questions and answers are written, and which registers do what."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol


class BusRegister(Protocol):
    """A number in a servo's memory."""

    @property
    def address(self) -> int:
        """Of its first byte."""

    @property
    def length(self) -> int:
        """In bytes."""

    def read(self, memory: bytes | bytearray, /) -> int:
        """Its value in a memory."""

    def write(self, memory: bytearray, value: int, /) -> None:
        """Puts a value there."""


@dataclass(frozen=True)
class Answer:
    """What one servo answers. `refused`: why it did not do as told, in words; empty: it did."""

    id: int
    data: bytes = b""
    refused: str = ""


class AnswerReader(Protocol):
    """Finds answers in a stream of bytes; what is none is skipped."""

    def feed(self, data: bytes, /) -> Iterator[Answer]:
        """The answers that are complete with these bytes."""


class BusProtocol(Protocol):
    """Questions as bytes, and a reader of what is answered to one; an echo of the question is no answer."""

    def ping(self, number: int) -> bytes:
        """Is it there?"""

    def read(self, number: int, address: int, length: int) -> bytes:
        """What stands there?"""

    def read_all(self, numbers: Sequence[int], address: int, length: int) -> bytes:
        """What stands there, in each of these?"""

    def write(self, number: int, address: int, data: bytes) -> bytes:
        """Put this there."""

    def write_all(self, address: int, data: Mapping[int, bytes]) -> bytes:
        """Put these there, in each its own; nobody answers."""

    def answers(self, question: bytes) -> AnswerReader:
        """Reader of the answers to a question."""


@dataclass(frozen=True)
class BusServoKind:
    """A kind of servos of 4096 counts a turn.

    Attributes:
        prefix: of its name in `--robot`. baud: usual bits per second. models: names by model number.
        modes: those that go to angles. last_read: registers below say all of a servo's settings and state.
        limit: register that bounds its torque until it is switched on anew; most: that of its greatest value.
    """

    prefix: str
    protocol: BusProtocol
    baud: int
    models: Mapping[int, str]
    modes: tuple[int, ...]
    last_read: int
    model: BusRegister
    mode: BusRegister
    least: BusRegister
    greatest: BusRegister
    torque: BusRegister
    goal: BusRegister
    position: BusRegister
    temperature: BusRegister
    limit: BusRegister
    most: BusRegister
