"""Messages of the servo link: a constructor and a parser for each frame type. Specification: docs/protocol.md.

The bytes are those of `lrmd.link.frames`; firmware/ is the peer.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass
from enum import IntEnum, IntFlag
from typing import Final

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD, PRESCALE_MAX, PRESCALE_MIN
from lrmd.link.frames import CHANNELS, BadFrame, BadFrameReason, Frame, FrameType, ProtocolError

VERSION: Final = 1
SILENCE_MS_MIN, SILENCE_MS_MAX, SILENCE_MS_DEFAULT = 50, 10_000, 1_000


class ErrorCode(IntEnum):
    """Reason why a board refused a frame; the lowest code that applies."""

    SHAPE = 1
    CRC = 2
    UNKNOWN_TYPE = 3
    VALUE = 4
    NOT_SET_UP = 5
    CHIP = 6
    TOO_LONG = 7


class OtherVersion(ProtocolError):
    """A board that speaks another `version` of the protocol."""

    def __init__(self, version: int) -> None:
        self.version = version
        super().__init__(f"the board speaks protocol {version}, this software {VERSION}: flash firmware/ anew")


class BoardStatus(IntFlag):
    """State of a board. SET_UP: a SETUP with a prescale was accepted since power-on."""

    PULSING = 1
    SILENCED = 2
    CHIP_FAULT = 4
    SET_UP = 8


@dataclass(frozen=True, slots=True)
class Ack:
    """A board's answer to ARM and SETUP: its state after the frame, and the boot number, 1 to 65535."""

    status: BoardStatus
    boot: int


@dataclass(frozen=True, slots=True)
class BoardError:
    """A board's ERROR. `index`, with VALUE only: the channel of ARM or the bit of another type's mask."""

    code: ErrorCode
    index: int | None = None


@dataclass(frozen=True, slots=True)
class BoardInfo:
    """A board's answer to HELLO. `accepted` (including this HELLO) and `refused` are modulo 65536."""

    version: int
    boot: int
    status: BoardStatus
    prescale: int
    silence_ms: int
    accepted: int
    refused: int
    kind: int

    @property
    def simulated(self) -> bool:
        """Whether the board has no hardware."""
        return self.kind != 0


def arm(seq: int, counts: Mapping[int, int]) -> Frame:
    """ARM: OFF count 1 to 4095 per channel 0 to 15, or 0 for off. Raises `ProtocolError` outside these ranges."""
    _within("channel", counts, 0, CHANNELS - 1)
    _within("count", counts.values(), 0, COUNTS_PER_PERIOD - 1)
    return _masked(FrameType.ARM, seq, counts)


def setup(seq: int, prescale: int, silence_ms: int) -> Frame:
    """SETUP: prescale 3 to 255, silence timeout 50 to 10000 ms. Raises `ProtocolError` outside these ranges."""
    _within("prescale", (prescale,), PRESCALE_MIN, PRESCALE_MAX)
    _within("silence timeout (ms)", (silence_ms,), SILENCE_MS_MIN, SILENCE_MS_MAX)
    return Frame(FrameType.SETUP, seq, 0b11, (prescale, silence_ms))


def read(seq: int, channels: Iterable[int]) -> Frame:
    """READ: requests the counts of these channels."""
    wanted = tuple(channels)
    _within("channel", wanted, 0, CHANNELS - 1)
    return Frame(FrameType.READ, seq, sum(1 << channel for channel in set(wanted)))


def hello(seq: int) -> Frame:
    """HELLO: requests INFO."""
    return Frame(FrameType.HELLO, seq, 0)


def ack(seq: int, status: BoardStatus, boot: int) -> Frame:
    """ACK to frame `seq`."""
    return Frame(FrameType.ACK, seq, 0b11, (status, boot))


def error(seq: int, code: ErrorCode, index: int = 0) -> Frame:
    """ERROR to frame `seq`; `index` is sent with VALUE only."""
    return Frame(FrameType.ERROR, seq, *((0b11, (code, index)) if code is ErrorCode.VALUE else (0b1, (code,))))


def error_to(bad: BadFrame) -> Frame:
    """ERROR to bytes that are no frame; its seq is 0."""
    codes = {BadFrameReason.CRC: ErrorCode.CRC, BadFrameReason.TOO_LONG: ErrorCode.TOO_LONG}
    return error(0, codes.get(bad.reason, ErrorCode.SHAPE))


def state(seq: int, counts: Mapping[int, int]) -> Frame:
    """STATE to frame `seq`: counts by channel, 0 = off."""
    return _masked(FrameType.STATE, seq, counts)


def info(seq: int, content: BoardInfo) -> Frame:
    """INFO to frame `seq`."""
    return Frame(FrameType.INFO, seq, 0xFF, astuple(content))


def ack_of(frame: Frame) -> Ack:
    """Parses an ACK. Raises `ProtocolError` on invalid content."""
    status, boot = _words(frame, FrameType.ACK, 0b11)
    return Ack(_status(status), _boot(boot))


def error_of(frame: Frame) -> BoardError:
    """Parses an ERROR. Raises `ProtocolError` on invalid content."""
    code, *index = _words(frame, FrameType.ERROR, 0b11 if frame.mask == 0b11 else 0b1)
    _within("error code", (code,), ErrorCode.SHAPE, ErrorCode.TOO_LONG)
    if bool(index) != (code == ErrorCode.VALUE):
        raise ProtocolError(f"ERROR {code} with mask {frame.mask:#06x}; an index comes with code 4 and only there")
    _within("index", index, 0, CHANNELS - 1)
    return BoardError(ErrorCode(code), index[0] if index else None)


def state_of(frame: Frame) -> dict[int, int]:
    """Parses a STATE: counts by channel, 0 = off. Raises `ProtocolError` on invalid content."""
    _within("count", _words(frame, FrameType.STATE, frame.mask), 0, COUNTS_PER_PERIOD - 1)
    return frame.word_by_bit()


def info_of(frame: Frame) -> BoardInfo:
    """Parses an INFO. Raises `ProtocolError` on invalid content, `OtherVersion` on another protocol version.

    The version comes first in every one, whatever follows it there.
    """
    if frame.type == FrameType.INFO and frame.mask & 1 and frame.words[0] != VERSION:
        raise OtherVersion(frame.words[0])
    version, boot, status, prescale, silence_ms, accepted, refused, kind = _words(frame, FrameType.INFO, 0xFF)
    _within("prescale", (prescale,), PRESCALE_MIN, PRESCALE_MAX)
    _within("silence timeout (ms)", (silence_ms,), SILENCE_MS_MIN, SILENCE_MS_MAX)
    return BoardInfo(version, _boot(boot), _status(status), prescale, silence_ms, accepted, refused, kind)


def _masked(kind: FrameType, seq: int, words: Mapping[int, int]) -> Frame:
    channels = sorted(words)
    return Frame(kind, seq, sum(1 << channel for channel in channels), tuple(words[channel] for channel in channels))


def _words(frame: Frame, kind: FrameType, mask: int) -> tuple[int, ...]:
    if frame.type != kind or frame.mask != mask:
        raise ProtocolError(
            f"frame of type {frame.type:#04x}, mask {frame.mask:#06x} is no {kind.name}: {kind:#04x}, {mask:#06x}"
        )
    return frame.words


def _status(word: int) -> BoardStatus:
    if word & ~0xF:
        raise ProtocolError(f"status {word:#06x}: only bits 0 to 3 have a meaning")
    return BoardStatus(word)


def _boot(word: int) -> int:
    _within("boot number", (word,), 1, 0xFFFF)
    return word


def _within(what: str, values: Iterable[int], low: int, high: int) -> None:
    for value in values:
        if not low <= value <= high:
            raise ProtocolError(f"{what} {value}: needs to be {low} to {high}")
