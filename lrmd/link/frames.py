"""Sans-io codec of the servo link's frames: bytes <-> values. Specification: docs/protocol.md.

frame = type u8 | seq u8 | mask u16 | word u16 x popcount(mask), lowest bit first | crc u16    (little endian)
wire  = COBS(frame), 0x00

COBS is consistent overhead byte stuffing (Cheshire & Baker 1999): up to 253 bytes it adds exactly one byte and is a
bijection, so no two wire forms decode to the same payload. CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF.
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from struct import Struct
from typing import Final

from lrm_math.errors import LrmError

CHANNELS: Final = 16
SHORTEST_FRAME: Final = 6
LONGEST_FRAME: Final = SHORTEST_FRAME + 2 * CHANNELS
LONGEST_WIRE: Final = LONGEST_FRAME + 1
LONGEST_PAYLOAD: Final = 253
_CODE: Final = tuple(bytes((n + 1,)) for n in range(LONGEST_PAYLOAD + 1))


class ProtocolError(LrmError):
    """Invalid field of a frame, or content that does not fit its type."""


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


class BadFrameReason(StrEnum):
    """Reason why bytes could not be decoded."""

    COBS = "cobs"
    LENGTH = "length"
    CRC = "crc"
    TOO_LONG = "too_long"


@dataclass(frozen=True, slots=True)
class BadFrame:
    """Bytes between two 0x00 that are not a valid frame."""

    reason: BadFrameReason


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame: `words` belong to the set bits of `mask`, lowest first; READ and HELLO carry none.

    Raises `ProtocolError` if a field exceeds its width; the values are checked in `lrmd.link.protocol`.
    """

    type: FrameType | int
    seq: int
    mask: int
    words: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not (0 <= self.type <= 0xFF and 0 <= self.seq <= 0xFF and 0 <= self.mask <= 0xFFFF):
            raise ProtocolError(f"type {self.type}, seq {self.seq}, mask {self.mask}: need 8, 8 and 16 bits")
        if len(self.words) != word_count(self.type, self.mask):
            need = word_count(self.type, self.mask)
            raise ProtocolError(
                f"type {self.type:#04x} with mask {self.mask:#06x} has {len(self.words)} words, not {need}"
            )
        if self.words and not (min(self.words) >= 0 and max(self.words) <= 0xFFFF):
            raise ProtocolError(f"words {self.words}: each needs to fit 16 bits")

    def word_by_bit(self) -> dict[int, int]:
        """Words keyed by their bit of the mask, lowest first."""
        return dict(zip(bits_of(self.mask), self.words, strict=False))


def word_count(kind: int, mask: int) -> int:
    """Number of words in a frame of type `kind`."""
    return 0 if kind in WITHOUT_WORDS else mask.bit_count()


def bits_of(mask: int) -> tuple[int, ...]:
    """Indices of the set bits, lowest first."""
    return tuple(bit for bit in range(CHANNELS) if mask >> bit & 1)


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE of `data`; of b"123456789" it is 0x29B1."""
    return binascii.crc_hqx(data, 0xFFFF)


def cobs_encode(payload: bytes) -> bytes:
    """The stuffed payload: free of 0x00, one byte longer. Raises `LrmError` beyond 253 bytes."""
    if len(payload) > LONGEST_PAYLOAD:
        raise LrmError(f"COBS: {len(payload)} bytes; a payload of this link has at most {LONGEST_PAYLOAD}")
    return b"".join([_CODE[len(run)] + run for run in payload.split(b"\0")])


def cobs_decode(wire: bytes) -> bytes | None:
    """The payload of `wire` (without the final 0x00), or None if the bytes are not valid COBS."""
    end = len(wire)
    out, at = bytearray(wire), 0
    while at < end:
        step = wire[at]
        if not step:
            return None
        out[at] = 0
        at += step
    return bytes(out[1:]) if at == end and 0 < end <= LONGEST_PAYLOAD + 1 and b"\0" not in wire else None


_BODY: Final = tuple(Struct(f"<BBH{n}H") for n in range(CHANNELS + 1))


def encode(frame: Frame) -> bytes:
    """The frame's bytes on the wire, including the final 0x00."""
    body = _BODY[len(frame.words)].pack(frame.type, frame.seq, frame.mask, *frame.words)
    return cobs_encode(body + crc16(body).to_bytes(2, "little")) + b"\0"


def decode(wire: bytes) -> Frame | BadFrame:
    """Decodes the bytes between two 0x00. Never raises; a `BadFrame` has the first reason that applies."""
    if len(wire) > LONGEST_WIRE:
        return BadFrame(BadFrameReason.TOO_LONG)
    body = cobs_decode(wire)
    if body is None:
        return BadFrame(BadFrameReason.COBS)
    mask = int.from_bytes(body[2:4], "little")
    if len(body) < SHORTEST_FRAME or len(body) != SHORTEST_FRAME + 2 * word_count(body[0], mask):
        return BadFrame(BadFrameReason.LENGTH)
    if crc16(body[:-2]) != int.from_bytes(body[-2:], "little"):
        return BadFrame(BadFrameReason.CRC)
    kind, seq, mask, *words = _BODY[(len(body) - SHORTEST_FRAME) // 2].unpack(body[:-2])
    return Frame(_TYPES.get(kind, kind), seq, mask, tuple(words))


class FrameDecoder:
    """Incremental decoder of a byte stream: holds at most `LONGEST_WIRE` bytes and resynchronises at each 0x00."""

    __slots__ = ("_dropping", "_rest")

    def __init__(self) -> None:
        self._rest = b""
        self._dropping = False

    def feed(self, data: bytes) -> list[Frame | BadFrame]:
        """Frames and bad frames completed by `data`. Any chunking of a stream gives the same list."""
        *pieces, rest = (self._rest + data).split(b"\0")
        if self._dropping:
            if not pieces:
                return []
            del pieces[0]
        events = [decode(piece) for piece in pieces if piece]
        self._dropping = len(rest) > LONGEST_WIRE
        if self._dropping:
            events.append(BadFrame(BadFrameReason.TOO_LONG))
        self._rest = b"" if self._dropping else rest
        return events
