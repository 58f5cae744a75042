"""A simulated STS3215: its registers, and a shaft that goes to its goal at a bounded speed.

Not simulated: speed and step modes, acceleration, protections against overload and overheating.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from lrm_ident.measuring.servo_bus import feetech as table
from lrm_ident.measuring.servo_bus.kind import Register
from lrmd.sim.servo import ServoKind, remaining_travel, winding_rise

TURN, MIDDLE = 4096, 2048
"""Counts."""
STEP = 2.0 * math.pi / TURN
"""rad for one count."""
STALL_NM = 2.94
"""N·m at 12 V: 30 kg·cm by the catalogue."""
AMBIENT_C = 25.0
STS3215 = ServoKind(speed=math.radians(60.0) / 0.222, rise=12.0)
"""Catalogue speed at no load; the rise of temperature is an estimate."""
ARRIVED = 1e-6
"""rad."""
SIZE, EEPROM_END = 88, 40
"""Bytes of the memory; registers below keep their value without power if they were written while `LOCK` was 0."""
READ_ONLY = frozenset({*range(5), *range(56, 71)})
"""Addresses that a host cannot write."""
FIRMWARE_MAJOR, FIRMWARE_MINOR, STATUS_LEVEL = Register(0), Register(1), Register(8)
MAX_TEMPERATURE, P_GAIN, D_GAIN, DEAD_ZONE = Register(13), Register(21), Register(22), Register(26)
LOCK, LOAD, VOLTAGE = Register(55), Register(60, 2, sign=10), Register(62)
MOVING, CURRENT = Register(66), Register(69, 2, sign=15)


def memory_of(size: int, values: Iterable[tuple[Register, int]]) -> bytearray:
    """Memory of so many bytes with the values of some registers; the others are zero."""
    memory = bytearray(size)
    for register, value in values:
        register.write(memory, value)
    return memory


def factory_memory(number: int) -> bytearray:
    """Memory of a new servo with an id."""
    values = (
        (FIRMWARE_MAJOR, 3), (FIRMWARE_MINOR, 10), (table.MODEL, table.MODEL_STS3215), (table.ID, number),
        (STATUS_LEVEL, 1), (table.MAX_POSITION, 4095), (MAX_TEMPERATURE, 70), (table.MAX_TORQUE, 1000), (P_GAIN, 32),
        (D_GAIN, 32), (table.TORQUE_LIMIT, 1000), (LOCK, 1), (VOLTAGE, 120),
    )  # fmt: skip
    return memory_of(SIZE, values)


@dataclass
class FeetechServo:
    """One servo.

    Attributes:
        angle: rad, of its shaft from the middle of the encoder's turn. torque: N·m, of the load. rise: K over ambient.
        pending: what a REG_WRITE left for the next ACTION: address and bytes. error: of what it was told last.
        counts_turns: whether its firmware reads beyond a turn.
    """

    number: int
    angle: float = 0.0
    torque: float = 0.0
    rise: float = 0.0
    memory: bytearray = field(default_factory=bytearray, repr=False)
    saved: bytearray = field(default_factory=bytearray, repr=False)
    pending: tuple[int, bytes] | None = None
    error: int = 0
    counts_turns: bool = False

    def __post_init__(self) -> None:
        self.memory = self.memory or factory_memory(self.number)
        self.saved = bytearray(self.memory)

    @property
    def id(self) -> int:
        """Number on the bus."""
        return table.ID.read(self.memory)

    @property
    def powered(self) -> bool:
        """Whether it holds torque."""
        return bool(table.TORQUE_ENABLE.read(self.memory))

    @property
    def target(self) -> float:
        """rad, of the goal within the position limits; where it stands while it has no torque."""
        if not self.powered:
            return self.angle
        goal = table.GOAL_POSITION.read(self.memory)
        low, high = table.MIN_POSITION.read(self.memory), table.MAX_POSITION.read(self.memory)
        return (min(max(goal, low), high) + self._unwound - self.count + self._zero) * STEP

    @property
    def moving(self) -> bool:
        """Whether it is on its way."""
        return abs(self.target - self.angle) > max(ARRIVED, self._band)

    @property
    def _band(self) -> float:
        return DEAD_ZONE.read(self.memory) * STEP

    @property
    def count(self) -> int:
        """Reading of its encoder, less the homing offset: within a turn, unless its firmware counts them."""
        return self._unwound if self.counts_turns else self._unwound % TURN

    @property
    def _zero(self) -> int:
        return table.HOMING_OFFSET.read(self.memory) - MIDDLE

    @property
    def _unwound(self) -> int:
        return round(self.angle / STEP) - self._zero

    def advance(self, dt: float) -> None:
        """Moves and warms for `dt` s."""
        target = self.target
        self.angle = target - remaining_travel(target - self.angle, dt, STS3215, self._band)
        self.rise = winding_rise(self.rise, self.torque if self.powered else 0.0, dt, STS3215)

    def read(self, address: int, length: int) -> bytes:
        """Registers as they are now; zeros beyond the table."""
        load = round(1000.0 * self.torque / STALL_NM) if self.powered else 0
        for register, value in (
            (table.POSITION, self.count), (LOAD, load), (CURRENT, load),
            (table.TEMPERATURE, round(AMBIENT_C + self.rise)), (MOVING, int(self.moving)),
        ):  # fmt: skip
            register.write(self.memory, value)
        return bytes(self.memory[address : address + length]).ljust(length, b"\0")

    def write(self, address: int, data: bytes) -> None:
        """Writes registers, but for those that only it writes itself. A goal switches its torque on, as the firmware
        does (huggingface/lerobot issue 3585)."""
        was_powered = self.powered
        for at, byte in enumerate(data, start=address):
            if at < SIZE and at not in READ_ONLY:
                self.memory[at] = byte
                if at < EEPROM_END and not LOCK.read(self.memory):
                    self.saved[at] = byte
        if self.powered and not was_powered:  # it holds where it is, whatever the goal was
            table.GOAL_POSITION.write(self.memory, self.count)
        if address <= table.GOAL_POSITION.address < address + len(data):
            table.TORQUE_ENABLE.write(self.memory, 1)

    def power_cycle(self) -> None:
        """Loses power: what was not saved is as it was, and there is no torque."""
        self.memory = bytearray(self.saved)
        table.TORQUE_ENABLE.write(self.memory, 0)
