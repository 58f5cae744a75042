"""Frames of the servo link: bytes <-> values, without any input or output. The contract is docs/protocol.md.

frame = type u8 | seq u8 | mask u16 | word u16 x popcount(mask), lowest bit first | crc u16    (little endian)
wire  = COBS(frame), 0x00
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from struct import Struct
from typing import Final

from lrm_math.errors import LrmError
from lrmd.link.cobs import cobs_decode, cobs_encode, crc16

CHANNELS: Final = 16
SHORTEST_FRAME: Final = 6
LONGEST_FRAME: Final = SHORTEST_FRAME + 2 * CHANNELS
LONGEST_WIRE: Final = LONGEST_FRAME + 1


class ProtocolError(LrmError):
    """A frame that cannot be, or that does not say what its type promises."""


class FrameType(IntEnum):
    """The first byte of a frame; below 0x80 from the host, above from the board."""

    ARM = 0x01
    SETUP = 0x02
    READ = 0x03
    HELLO = 0x04
    ACK = 0x81
    ERROR = 0x82
    STATE = 0x83
    INFO = 0x84


WITHOUT_WORDS: Final = frozenset({FrameType.READ, FrameType.HELLO})
_TYPES: Final = {int(kind): kind for kind in FrameType}


class Reason(StrEnum):
    """Why bytes were no frame."""

    COBS = "cobs"
    LENGTH = "length"
    CRC = "crc"
    TOO_LONG = "too_long"


@dataclass(frozen=True, slots=True)
class Bad:
    """Bytes between two 0x00 that were no frame."""

    reason: Reason


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame: `words` belong to the set bits of `mask`, lowest first; READ and HELLO carry none.

    Raises `ProtocolError` if the fields do not fit the wire. What the words mean is checked by who reads them.
    """

    type: FrameType | int
    seq: int
    mask: int
    words: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not (0 <= self.type <= 0xFF and 0 <= self.seq <= 0xFF and 0 <= self.mask <= 0xFFFF):
            raise ProtocolError(f"type {self.type}, seq {self.seq}, mask {self.mask}: need 8, 8 and 16 bits")
        if len(self.words) != words_of(self.type, self.mask):
            need = words_of(self.type, self.mask)
            raise ProtocolError(
                f"type {self.type:#04x} with mask {self.mask:#06x} has {len(self.words)} words, not {need}"
            )
        if self.words and not (min(self.words) >= 0 and max(self.words) <= 0xFFFF):
            raise ProtocolError(f"words {self.words}: each needs to fit 16 bits")

    def items(self) -> dict[int, int]:
        """Word by bit of the mask, lowest first."""
        return dict(zip(bits_of(self.mask), self.words, strict=False))


def words_of(kind: int, mask: int) -> int:
    """How many words a frame of type `kind` carries."""
    return 0 if kind in WITHOUT_WORDS else mask.bit_count()


def bits_of(mask: int) -> tuple[int, ...]:
    """The set bits of a mask, lowest first."""
    return tuple(bit for bit in range(CHANNELS) if mask >> bit & 1)


_BODY: Final = tuple(Struct(f"<BBH{n}H") for n in range(CHANNELS + 1))


def encode(frame: Frame) -> bytes:
    """The frame as it goes over the wire, with the 0x00 that ends it."""
    body = _BODY[len(frame.words)].pack(frame.type, frame.seq, frame.mask, *frame.words)
    return cobs_encode(body + crc16(body).to_bytes(2, "little")) + b"\0"


def decode(wire: bytes) -> Frame | Bad:
    """One frame from the bytes between two 0x00. Never raises; the first reason that holds is the one told."""
    if len(wire) > LONGEST_WIRE:
        return Bad(Reason.TOO_LONG)
    body = cobs_decode(wire)
    if body is None:
        return Bad(Reason.COBS)
    mask = int.from_bytes(body[2:4], "little")
    if len(body) < SHORTEST_FRAME or len(body) != SHORTEST_FRAME + 2 * words_of(body[0], mask):
        return Bad(Reason.LENGTH)
    if crc16(body[:-2]) != int.from_bytes(body[-2:], "little"):
        return Bad(Reason.CRC)
    kind, seq, mask, *words = _BODY[(len(body) - SHORTEST_FRAME) // 2].unpack(body[:-2])
    return Frame(_TYPES.get(kind, kind), seq, mask, tuple(words))


class Decoder:
    """A byte stream cut into frames. Holds at most `LONGEST_WIRE` bytes; each 0x00 is a new start."""

    __slots__ = ("_dropping", "_rest")

    def __init__(self) -> None:
        self._rest = b""
        self._dropping = False

    def feed(self, data: bytes) -> list[Frame | Bad]:
        """The frames, and what was none, that these bytes complete. Any chunking of a stream gives the same list."""
        *pieces, rest = (self._rest + data).split(b"\0")
        if self._dropping:
            if not pieces:
                return []
            del pieces[0]
        events = [decode(piece) for piece in pieces if piece]
        self._dropping = len(rest) > LONGEST_WIRE
        if self._dropping:
            events.append(Bad(Reason.TOO_LONG))
        self._rest = b"" if self._dropping else rest
        return events
