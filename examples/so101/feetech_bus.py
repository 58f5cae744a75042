"""A simulated half-duplex bus of Feetech servos: packets in, status packets out, time going on in between."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from itertools import zip_longest

from examples.so101.feetech_servo import STATUS_LEVEL, FeetechServo
from lrm_ident.measuring.servo_bus import feetech as table
from lrm_ident.measuring.servo_bus.feetech import FeetechPacket
from lrm_ident.measuring.servo_bus.kind import BROADCAST, Instruction, Packet, PacketReader

NO_ERROR = 0
ALL = 1
"""Status level at which every instruction is answered; at 0 only PING and READ are."""


class FeetechBus:
    """Servos on one wire. `goals`: how many goals it has taken so far. `dead_time`: s, until a servo acts on one.

    `on_change`: called whenever the servos stand still after a move, and before each instruction that may change where
    they go: between two calls every shaft turns one way only.
    """

    def __init__(
        self, servos: Sequence[FeetechServo], on_change: Callable[[], None] = lambda: None, dead_time: float = 0.0
    ) -> None:
        self.servos, self.dead_time = tuple(servos), dead_time
        self.now = 0.0
        self.goals = 0
        self._on_change = on_change
        self._reader = self.reader()
        self._rested = True
        self._late = deque[tuple[float, FeetechServo, int, bytes]]()

    WORD = 1
    """Bytes of an address, and of a length."""
    GOAL = table.GOAL_POSITION.address

    def reader(self) -> PacketReader[Packet]:
        """A reader of what a host says."""
        return PacketReader[Packet](FeetechPacket)

    def status(self, number: int, error: int = NO_ERROR, data: bytes = b"") -> bytes:
        """Answer of a servo by its number."""
        return FeetechPacket(number, error, data).encoded()

    def pinged(self, servo: FeetechServo) -> bytes:
        """Answer of a servo to a ping."""
        return self.status(servo.id)

    def _word(self, given: bytes, place: int = 0) -> int:
        return int.from_bytes(given[place * self.WORD : (place + 1) * self.WORD], "little")

    @property
    def moving(self) -> bool:
        """Whether a servo is on its way, or has a goal that it does not act on yet."""
        return bool(self._late) or any(servo.moving for servo in self.servos)

    def advance(self, now: float) -> None:
        """Lets the servos move until a time (s)."""
        while self._late and self._late[0][0] <= now:
            due, servo, address, data = self._late.popleft()
            self._turn(due)
            self._store(servo, address, data)
        self._turn(now)

    def _turn(self, now: float) -> None:
        for servo in self.servos:
            servo.advance(max(0.0, now - self.now))
        self.now = max(now, self.now)
        if not self._rested and not any(servo.moving for servo in self.servos):
            self._rested = True
            self._on_change()

    def feed(self, data: bytes, now: float) -> bytes:
        """Answers of the servos to bytes that arrive at a time (s)."""
        self.advance(now)
        return b"".join(self._answer(packet) for packet in self._reader.feed(data))

    def _answer(self, packet: Packet) -> bytes:
        if packet.code == Instruction.SYNC_READ:
            return self._sync_read(packet.parameters)
        if packet.code == Instruction.SYNC_WRITE:
            self._sync_write(packet.parameters)
            return b""
        called = [servo for servo in self.servos if packet.id in (servo.id, BROADCAST)]
        if packet.id == BROADCAST and packet.code != Instruction.PING:
            for servo in called:
                self._reply(servo, packet)
            return b""
        if packet.id == BROADCAST:
            return b"".join(garbled([self.pinged(s) for s in called if s.id == one]) for one in _ids(called))
        return garbled([self._reply(servo, packet) for servo in called])

    def _reply(self, servo: FeetechServo, packet: Packet) -> bytes:
        """Carries out an instruction for one servo."""
        level, given = STATUS_LEVEL.read(servo.memory), packet.parameters
        if packet.code == Instruction.PING:
            return self.pinged(servo)
        if packet.code == Instruction.READ and len(given) == 2 * self.WORD:
            return self._said(servo, given)
        if packet.code == Instruction.WRITE and given:
            own = servo.id
            self._write(servo, self._word(given), given[self.WORD :])
            return self.status(own, servo.error) if level >= ALL else b""
        if packet.code == Instruction.REG_WRITE and given:
            servo.pending = self._word(given), given[self.WORD :]
        elif packet.code == Instruction.ACTION:
            if servo.pending is not None:
                self._write(servo, *servo.pending)
            servo.pending = None
        else:
            return b""
        return self.status(servo.id, servo.error) if level >= ALL else b""

    def _said(self, servo: FeetechServo, given: bytes) -> bytes:
        """Answer to a request for a length of bytes from an address."""
        data = servo.read(self._word(given), self._word(given, 1))
        return self.status(servo.id, servo.error, data)

    def _sync_read(self, given: bytes) -> bytes:
        """Start, length, ids: each answers for itself, in that order."""
        out = b""
        for one in given[2 * self.WORD :]:
            called = [servo for servo in self.servos if servo.id == one]
            out += garbled([self._said(servo, given) for servo in called])
        return out

    def _sync_write(self, given: bytes) -> None:
        """Start, length, then id and data of each; nobody answers."""
        start, length = self._word(given), self._word(given, 1)
        self.goals += start <= self.GOAL < start + length
        for at in range(2 * self.WORD, len(given) - length, length + 1):
            for servo in self.servos:
                if servo.id == given[at]:
                    self._write(servo, start, given[at + 1 : at + 1 + length])

    def _write(self, servo: FeetechServo, address: int, data: bytes) -> None:
        if self.dead_time and address <= self.GOAL < address + len(data):
            self._late.append((self.now + self.dead_time, servo, address, data))
        else:
            self._store(servo, address, data)

    def _store(self, servo: FeetechServo, address: int, data: bytes) -> None:
        before = servo.target
        if not self._rested:
            self._on_change()
        servo.write(address, data)
        if servo.target != before:
            self._rested = False


def _ids(servos: Sequence[FeetechServo]) -> Iterator[int]:
    yield from sorted({servo.id for servo in servos})


def garbled(answers: Sequence[bytes]) -> bytes:
    """Bytes that arrive of answers sent at once: a wire that anyone pulls low is low."""
    out = bytearray()
    for together in zip_longest(*answers, fillvalue=0xFF):
        byte = 0xFF
        for one in together:
            byte &= one
        out.append(byte)
    return bytes(out)
