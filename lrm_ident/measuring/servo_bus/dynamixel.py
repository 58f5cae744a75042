"""Dynamixel's X series (e-Manual, XL330 and XL430): packets of protocol 2.0, and the control table.

Packets begin with FF FF FD 00; the first parameter of a status is its error. Wherever FF FF FD stands in instruction
and parameters, an FD is stuffed behind it, so that a header is one. The checksum is a CRC-16 (polynomial 8005, from 0,
high bit first) of all bytes before it (Robotis, e-Manual, "DYNAMIXEL Protocol 2.0").
"""

from __future__ import annotations

from lrm_ident.measuring.servo_bus.kind import Answer, BusServoKind, Instruction, Packet, Register, TwosComplement

STUFFED = b"\xff\xff\xfd"
POLYNOMIAL = 0x8005
ALERT = 0x80
"""Bit of the error of a servo that has shut down, or is about to; the others are of the question."""
ERRORS = {
    1: "it failed", 2: "unknown instruction", 3: "wrong CRC", 4: "out of range", 5: "wrong length",
    6: "beyond its limit", 7: "not writable now",
}  # fmt: skip


class DynamixelPacket(Packet):
    """See `Packet`. `LONGEST`: what fits a servo's buffer."""

    HEADER, WORD, LONGEST = b"\xff\xff\xfd\x00", 2, 1024

    @staticmethod
    def checksum(before: bytes) -> int:
        """See `Packet`."""
        crc = 0
        for byte in before:
            crc ^= byte << 8
            for _ in range(8):
                crc = (crc << 1 ^ POLYNOMIAL if crc & 0x8000 else crc << 1) & 0xFFFF
        return crc

    @property
    def answer(self) -> Answer | None:
        """See `Packet`."""
        if self.code != Instruction.STATUS or not self.parameters:
            return None
        error = self.parameters[0] & ~ALERT
        return Answer(self.id, self.parameters[1:], ERRORS.get(error, f"error {error}") if error else "")

    @staticmethod
    def stuffed(body: bytes) -> bytes:
        """See `Packet`."""
        return body.replace(STUFFED, STUFFED + b"\xfd")

    @staticmethod
    def unstuffed(body: bytes) -> bytes:
        """See `Packet`."""
        return body.replace(STUFFED + b"\xfd", STUFFED)


SIZE = 147
"""Registers below say all of a servo's settings and state."""
MODELS = {
    1190: "XL330-M077", 1200: "XL330-M288", 1230: "XC330-M181", 1240: "XC330-M288", 1060: "XL430-W250",
    1070: "XC430-W150", 1080: "XC430-W240", 1020: "XM430-W350", 1030: "XM430-W210",
}  # fmt: skip
POSITION_MODE, CURRENT_POSITION_MODE = 3, 5

MODEL, ID, OPERATING_MODE = Register(0, 2), Register(7), Register(11)
PWM_LIMIT, MAX_POSITION, MIN_POSITION = Register(36, 2), Register(48, 4), Register(52, 4)
TORQUE_ENABLE = Register(64)
FIRMWARE, RETURN_DELAY = (Register(6),), Register(9)
D_GAIN, I_GAIN, P_GAIN = Register(80, 2), Register(82, 2), Register(84, 2)
DELAY_US = 2
"""Microseconds in one unit of the return delay."""
GOAL_PWM, GOAL_POSITION = TwosComplement(100, 2), TwosComplement(116, 4)
POSITION, TEMPERATURE = TwosComplement(132, 4), Register(146)
DYNAMIXEL = BusServoKind(
    prefix="dynamixel:",
    packet=DynamixelPacket,
    models=MODELS,
    modes=(POSITION_MODE, CURRENT_POSITION_MODE),
    last_read=SIZE,
    model=MODEL,
    mode=OPERATING_MODE,
    least=MIN_POSITION,
    greatest=MAX_POSITION,
    torque=TORQUE_ENABLE,
    goal=GOAL_POSITION,
    position=POSITION,
    temperature=TEMPERATURE,
    limit=GOAL_PWM,
    most=PWM_LIMIT,
    settings={
        "p": (P_GAIN, 1),
        "i": (I_GAIN, 1),
        "d": (D_GAIN, 1),
        "torque_limit": (PWM_LIMIT, 1),
        "return_delay_us": (RETURN_DELAY, DELAY_US),
    },
    firmware=FIRMWARE,
)
"""The servos as a bus knows them."""
