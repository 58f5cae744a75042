"""A simulated bus of Dynamixel X servos: the shafts of the Feetech bus behind protocol 2.0 and another control table.

Not simulated: homing offset, profiles, current, modes other than position, hardware errors.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import AMBIENT_C, FeetechServo, memory_of
from lrm_ident.measuring.servo_bus import dynamixel as table
from lrm_ident.measuring.servo_bus import feetech as shaft
from lrm_ident.measuring.servo_bus.dynamixel import DynamixelPacket
from lrm_ident.measuring.servo_bus.kind import Instruction, Packet, PacketReader, Register

MIRRORED = (
    (table.ID, shaft.ID), (table.TORQUE_ENABLE, shaft.TORQUE_ENABLE), (table.GOAL_POSITION, shaft.GOAL_POSITION),
    (table.MIN_POSITION, shaft.MIN_POSITION), (table.MAX_POSITION, shaft.MAX_POSITION),
)  # fmt: skip
"""Registers that drive the shaft, and what they are in its own memory."""
NOT_NOW, BEYOND = 7, 6
EEPROM_END = 64
"""Registers below can be written without torque only."""
FIRMWARE, STATUS_RETURN, MOVING = Register(6), Register(68), Register(122)
READ_ONLY = frozenset({*range(7), *range(120, table.SIZE)})
"""Addresses that a host cannot write."""


def factory_memory(number: int) -> bytearray:
    """Memory of a new XL430 with an id."""
    values = (
        (table.MODEL, 1060), (FIRMWARE, 45), (table.ID, number), (table.OPERATING_MODE, table.POSITION_MODE),
        (table.PWM_LIMIT, 885), (table.MAX_POSITION, 4095), (STATUS_RETURN, 2), (table.GOAL_PWM, 885),
    )  # fmt: skip
    return memory_of(table.SIZE, values)


@dataclass
class DynamixelServo(FeetechServo):
    """One servo. `control`: its control table."""

    control: bytearray = field(default_factory=bytearray, repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.control = self.control or factory_memory(self.number)

    def read(self, address: int, length: int) -> bytes:
        """Registers as they are now; zeros beyond the table."""
        self.error = 0
        for register, value in (
            (table.POSITION, self.count), (MOVING, int(self.moving)),
            (table.TEMPERATURE, round(AMBIENT_C + self.rise)),
        ):  # fmt: skip
            register.write(self.control, value)
        return bytes(self.control[address : address + length]).ljust(length, b"\0")

    def write(self, address: int, data: bytes) -> None:
        """Writes registers as far as it may: its memory without torque only, a goal within the limits only."""
        self.error = self._refusal(address, data)
        if self.error:
            return
        was_powered = self.powered
        for at, byte in enumerate(data, start=address):
            if at < table.SIZE and at not in READ_ONLY:
                self.control[at] = byte
        for register, own in MIRRORED:
            own.write(self.memory, register.read(self.control))
        if self.powered and not was_powered:  # it holds where it is, whatever the goal was
            shaft.GOAL_POSITION.write(self.memory, self.count)

    def _refusal(self, address: int, data: bytes) -> int:
        if address < EEPROM_END and self.powered:
            return NOT_NOW
        after = self.control[:address] + data + self.control[address + len(data) :]
        goal, low, high = (r.read(after) for r in (table.GOAL_POSITION, table.MIN_POSITION, table.MAX_POSITION))
        if address == table.GOAL_POSITION.address and not low <= goal <= high:
            return BEYOND
        return BEYOND if abs(table.GOAL_PWM.read(after)) > table.PWM_LIMIT.read(after) else 0


class DynamixelBus(FeetechBus):
    """Servos on one wire, which speak protocol 2.0."""

    WORD = 2
    GOAL = table.GOAL_POSITION.address

    def reader(self) -> PacketReader[Packet]:
        """A reader of what a host says."""
        return PacketReader[Packet](DynamixelPacket)

    def status(self, number: int, error: int = 0, data: bytes = b"") -> bytes:
        """Answer of a servo by its number: an error byte, then the data."""
        return DynamixelPacket(number, Instruction.STATUS, bytes([error]) + data).encoded()

    def pinged(self, servo: FeetechServo) -> bytes:
        """Model number and firmware."""
        return self.status(servo.id, 0, servo.read(table.MODEL.address, 2) + servo.read(FIRMWARE.address, 1))
