"""Numbers in the memory of a servo, the low byte first."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Register:
    """A number of one or two bytes. `sign`: the bit that makes it negative; None: unsigned."""

    address: int
    length: int = 1
    sign: int | None = None

    def read(self, memory: bytes | bytearray) -> int:
        """Its value."""
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
        """Its value."""
        return int.from_bytes(memory[self.address : self.address + self.length], "little", signed=True)

    def write(self, memory: bytearray, value: int) -> None:
        """Puts a value there, cut to what it can hold."""
        half = 1 << (8 * self.length - 1)
        cut = min(max(value, -half), half - 1)
        memory[self.address : self.address + self.length] = cut.to_bytes(self.length, "little", signed=True)
