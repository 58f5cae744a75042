"""Codec of the servo link's frames, for MicroPython and CPython. Specification: docs/protocol.md.

A frame is a tuple (type, seq, mask, words); invalid bytes decode to an error code, an int.
"""

import struct

VERSION = 1
ARM, SETUP, READ, HELLO = 0x01, 0x02, 0x03, 0x04
ACK, ERROR, STATE, INFO = 0x81, 0x82, 0x83, 0x84
SHAPE, CRC, UNKNOWN_TYPE, VALUE, NOT_SET_UP, CHIP, TOO_LONG = 1, 2, 3, 4, 5, 6, 7
PULSING, SILENCED, CHIP_FAULT, SET_UP = 1, 2, 4, 8

CHANNELS = 16
SHORTEST_FRAME = 6
LONGEST_WIRE = SHORTEST_FRAME + 2 * CHANNELS + 1


def crc16(data):
    """CRC-16/CCITT-FALSE, bytewise without a table."""
    crc = 0xFFFF
    for byte in data:
        x = (crc >> 8) ^ byte
        x ^= x >> 4
        crc = ((crc << 8) ^ (x << 12) ^ (x << 5) ^ x) & 0xFFFF
    return crc


def cobs_encode(payload):
    """COBS encoding of at most 253 bytes: free of 0x00, one byte longer."""
    out = bytearray(b"\0") + payload
    run_start = 0
    for i in range(1, len(out)):
        if not out[i]:
            out[run_start] = i - run_start
            run_start = i
    out[run_start] = len(out) - run_start
    return out


def cobs_decode(wire):
    """The payload of `wire`, which holds no 0x00, or None."""
    out = bytearray(wire)
    at = 0
    while at < len(out):
        step = out[at]
        out[at] = 0
        at += step
    return out[1:] if at == len(out) else None


def bits_of(mask):
    """Indices of the set bits, lowest first."""
    return [bit for bit in range(CHANNELS) if mask >> bit & 1]


def encode(kind, seq, mask, words):
    """The frame's bytes on the wire, including the final 0x00."""
    body = struct.pack("<BBH" + "H" * len(words), kind, seq, mask, *words)
    return bytes(cobs_encode(body + struct.pack("<H", crc16(body)))) + b"\0"


def decode(wire):
    """Decodes the bytes between two 0x00 to a frame or an error code."""
    body = cobs_decode(wire)
    if body is None or len(body) < SHORTEST_FRAME:
        return SHAPE
    kind, seq, mask = struct.unpack("<BBH", body[:4])
    count = 0 if kind in (READ, HELLO) else len(bits_of(mask))
    if len(body) != SHORTEST_FRAME + 2 * count:
        return SHAPE
    if crc16(body[:-2]) != struct.unpack("<H", body[-2:])[0]:
        return CRC
    return kind, seq, mask, struct.unpack("<" + "H" * count, body[4:-2])


class Decoder:
    """Incremental decoder of a byte stream with a buffer of 39 bytes."""

    def __init__(self):
        self._buffer = bytearray(LONGEST_WIRE)
        self._length = 0

    def feed(self, data):
        """Frames and error codes completed by `data`."""
        events = []
        for byte in data:
            if not byte:
                if 0 < self._length <= LONGEST_WIRE:
                    events.append(decode(self._buffer[: self._length]))
                self._length = 0
            elif self._length < LONGEST_WIRE:
                self._buffer[self._length] = byte
                self._length += 1
            elif self._length == LONGEST_WIRE:
                events.append(TOO_LONG)
                self._length += 1
        return events
