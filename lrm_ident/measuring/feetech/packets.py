"""Packets of the Feetech STS protocol, which begin with FF FF; the code of a servo's is its error flags.

The checksum is the complement of the sum of all bytes between header and itself (Feetech, "Communication protocol user
manual"; the same frame as Dynamixel's protocol 1). Packets of host and servo look alike.
"""

from __future__ import annotations

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
