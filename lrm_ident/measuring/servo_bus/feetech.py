"""A Feetech STS3215 (its data sheet): packets, and the registers that matter here.

Packets begin with FF FF; the code of a servo's is its error flags. The checksum is the complement of the sum of all
bytes between header and itself (Feetech, "Communication protocol user manual"; the same frame as Dynamixel's protocol
1). Packets of host and servo look alike.
"""

from __future__ import annotations

from lrm_ident.measuring.servo_bus.kind import Answer, BusServoKind, Packet, Register


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


MODEL_STS3215, MODEL_STS3250 = 777, 2825

MODEL, ID = Register(3, 2), Register(5)
MIN_POSITION, MAX_POSITION = Register(9, 2), Register(11, 2)
MAX_TORQUE = Register(16, 2)
HOMING_OFFSET, MODE = Register(31, 2, sign=11), Register(33)
TORQUE_ENABLE, GOAL_POSITION = Register(40), Register(42, 2, sign=15)
TORQUE_LIMIT = Register(48, 2)
FIRMWARE, RETURN_DELAY = (Register(0), Register(1)), Register(7)
P_GAIN, D_GAIN, I_GAIN = Register(21), Register(22), Register(23)
DELAY_US = 2
"""Microseconds in one unit of the return delay."""
POSITION, TEMPERATURE = Register(56, 2, sign=15), Register(63)
LAST_READ = 71
"""Registers below say all of a servo's settings and state."""
FEETECH = BusServoKind(
    prefix="feetech:",
    packet=FeetechPacket,
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
    settings={
        "p": (P_GAIN, 1),
        "i": (I_GAIN, 1),
        "d": (D_GAIN, 1),
        "torque_limit": (MAX_TORQUE, 1),
        "return_delay_us": (RETURN_DELAY, DELAY_US),
    },
    firmware=FIRMWARE,
)
"""The servos as a bus knows them."""
