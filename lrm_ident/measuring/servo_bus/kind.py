"""Facts that a bus has to know of a kind of servos: how their packets are written, and which registers do what.

Registers are numbers in the memory of a servo, the low byte first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lrm_ident.measuring.servo_bus.packets import Packet


@dataclass(frozen=True)
class Register:
    """A number of one or two bytes. `sign`: the bit that makes it negative; None: unsigned."""

    address: int
    length: int = 1
    sign: int | None = None

    def read(self, memory: bytes | bytearray) -> int:
        """Value of the register."""
        raw = int.from_bytes(memory[self.address : self.address + self.length], "little")
        if self.sign is None:
            return raw
        size = raw & ~(1 << self.sign)
        return -size if raw >> self.sign & 1 else size

    def write(self, memory: bytearray, value: int) -> None:
        """Puts a value there, cut to what it can hold."""
        most = (1 << (8 * self.length if self.sign is None else self.sign)) - 1
        size = min(abs(value), most)
        raw = size | 1 << self.sign if self.sign is not None and value < 0 else size
        memory[self.address : self.address + self.length] = raw.to_bytes(self.length, "little")


class TwosComplement(Register):
    """A signed number as two's complement."""

    def read(self, memory: bytes | bytearray) -> int:
        """Value of the register."""
        return int.from_bytes(memory[self.address : self.address + self.length], "little", signed=True)

    def write(self, memory: bytearray, value: int) -> None:
        """Puts a value there, cut to what it can hold."""
        half = 1 << (8 * self.length - 1)
        cut = min(max(value, -half), half - 1)
        memory[self.address : self.address + self.length] = cut.to_bytes(self.length, "little", signed=True)


@dataclass(frozen=True)
class BusServoKind:
    """A kind of servos of 4096 counts a turn.

    Attributes:
        prefix: of its name in `--robot`. baud: usual bits per second. models: names by model number.
        modes: those that go to angles. last_read: registers below say all of a servo's settings and state.
        limit: register that bounds its torque until it is switched on anew; most: that of its greatest value.
    """

    prefix: str
    packet: type[Packet]
    baud: int
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
