"""A Feetech STS3215 (its data sheet): packets, and the memory table: which registers are signed, which can be written.

Packets begin with FF FF; the code of a servo's is its error flags. The checksum is the complement of the sum of all
bytes between header and itself (Feetech, "Communication protocol user manual"; the same frame as Dynamixel's protocol
1). Packets of host and servo look alike.
"""

from __future__ import annotations

from lrm_ident.measuring.servo_bus.kind import BusServoKind, Register, memory_of
from lrm_ident.measuring.servo_bus.packets import Answer, Packet


class FeetechPacket(Packet):
    """See `Packet`."""

    HEADER, WORD, LONGEST = b"\xff\xff", 1, 250

    @staticmethod
    def checksum(before: bytes) -> int:
        """See `Packet`."""
        return ~sum(before[2:]) & 0xFF

    @property
    def answer(self) -> Answer:
        """See `Packet`."""
        return Answer(self.id, self.parameters)


SIZE = 88
EEPROM_END = 40
"""Registers below keep their value without power if they were written while `LOCK` was 0."""
MODEL_STS3215, MODEL_STS3250 = 777, 2825

FIRMWARE_MAJOR, FIRMWARE_MINOR, MODEL = Register(0), Register(1), Register(3, 2)
ID, BAUD_RATE, STATUS_LEVEL = Register(5), Register(6), Register(8)
MIN_POSITION, MAX_POSITION = Register(9, 2), Register(11, 2)
MAX_TEMPERATURE, MAX_TORQUE = Register(13), Register(16, 2)
P_GAIN, D_GAIN = Register(21), Register(22)
DEAD_ZONE = Register(26)
HOMING_OFFSET, MODE = Register(31, 2, sign=11), Register(33)
TORQUE_ENABLE, GOAL_POSITION, GOAL_VELOCITY = Register(40), Register(42, 2, sign=15), Register(46, 2, sign=15)
TORQUE_LIMIT, LOCK = Register(48, 2), Register(55)
POSITION, VELOCITY, LOAD = Register(56, 2, sign=15), Register(58, 2, sign=15), Register(60, 2, sign=10)
VOLTAGE, TEMPERATURE, STATUS, MOVING, CURRENT = (
    Register(62), Register(63), Register(65), Register(66), Register(69, 2, sign=15),
)  # fmt: skip
LAST_READ = 71
"""Registers below say all of a servo's settings and state."""
READ_ONLY = frozenset({*range(5), *range(56, 71)})
"""Addresses that a host cannot write."""
FEETECH = BusServoKind(
    prefix="feetech:",
    packet=FeetechPacket,
    baud=1_000_000,
    models={MODEL_STS3215: "STS3215", MODEL_STS3250: "STS3250"},
    modes=(0,),
    last_read=LAST_READ,
    model=MODEL,
    mode=MODE,
    least=MIN_POSITION,
    greatest=MAX_POSITION,
    torque=TORQUE_ENABLE,
    goal=GOAL_POSITION,
    position=POSITION,
    temperature=TEMPERATURE,
    limit=TORQUE_LIMIT,
    most=MAX_TORQUE,
)
"""The servos as a bus knows them."""


def factory_memory(number: int) -> bytearray:
    """Memory of a new servo with an id."""
    values = (
        (FIRMWARE_MAJOR, 3), (FIRMWARE_MINOR, 10), (MODEL, MODEL_STS3215), (ID, number), (STATUS_LEVEL, 1),
        (MAX_POSITION, 4095), (MAX_TEMPERATURE, 70), (MAX_TORQUE, 1000), (P_GAIN, 32), (D_GAIN, 32),
        (TORQUE_LIMIT, 1000), (LOCK, 1), (VOLTAGE, 120),
    )  # fmt: skip
    return memory_of(SIZE, values)
