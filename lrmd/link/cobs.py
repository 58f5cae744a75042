"""Consistent overhead byte stuffing (Cheshire & Baker 1999) and CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF).

Up to 253 bytes the stuffing adds exactly one byte and is a bijection: no two wire forms decode to the same payload.
"""

from __future__ import annotations

import binascii

from lrm_math.errors import LrmError

LONGEST_PAYLOAD = 253
_CODE = tuple(bytes((n + 1,)) for n in range(LONGEST_PAYLOAD + 1))


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
