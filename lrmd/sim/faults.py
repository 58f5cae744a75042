"""Fault injection on the link and the board; the syntax of `--fault` and the control socket.

flip | lose | double  RATE|frame K  [in|out|both]      frames on the line, to the board (in) or from it (out)
stall | hangup | brownout | chip | chiploss  SECONDS   for a time
calm                                                   ends all rates
... at T                                               not now, but T s after the start, in the board's time
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Literal, TypeAlias, TypeVar, get_args

from lrm_math.errors import LrmError, name_suggestion

N = TypeVar("N", int, float)
Direction: TypeAlias = Literal["in", "out", "both"]


@dataclass(frozen=True)
class FrameFault:
    """Corrupts frames on the line: each with probability `rate`, or only number `frame` (from 1, since the start).

    `corrupted`: the bytes received instead of a frame, which ends with its 0x00.
    """

    corrupted: Callable[[bytes, Random], bytes]
    rate: float = 0.0
    frame: int | None = None
    direction: Direction = "in"

    def applies(self, number: int, random: Random) -> bool:
        """Whether frame `number` is corrupted."""
        return number == self.frame if self.frame is not None else random.random() < self.rate


def bit_flipped(wire: bytes, random: Random) -> bytes:
    """A frame with one bit changed, possibly of its final 0x00."""
    bit = random.randrange(8 * len(wire))
    out = bytearray(wire)
    out[bit // 8] ^= 1 << bit % 8
    return bytes(out)


def lost(_: bytes, __: Random) -> bytes:
    """Nothing of a frame."""
    return b""


def doubled(wire: bytes, _: Random) -> bytes:
    """A frame twice."""
    return wire + wire


@dataclass(frozen=True)
class TimedFault:
    """A fault of limited duration (s of the board's clock)."""

    seconds: float


class LineStall(TimedFault):
    """Link stall: bytes of both directions arrive late, all at once. The board keeps running."""


class HangUp(TimedFault):
    """USB disconnect: the device disappears and returns as a new one. The board keeps running."""


class BrownOut(TimedFault):
    """Power loss of the board: outputs off, state cleared, new boot number."""


class ChipSilence(TimedFault):
    """The PCA9685 does not acknowledge; its outputs stay unchanged."""


class ChipPowerLoss(TimedFault):
    """Power loss of the PCA9685 alone: outputs off, then registers as after power-on. The board keeps running."""


@dataclass(frozen=True)
class ClearFrameFaults:
    """Ends all frame faults."""


Fault: TypeAlias = FrameFault | TimedFault | ClearFrameFaults

FRAME_FAULTS = {"flip": bit_flipped, "lose": lost, "double": doubled}
TIMED_FAULTS: dict[str, type[TimedFault]] = {
    "stall": LineStall,
    "hangup": HangUp,
    "brownout": BrownOut,
    "chip": ChipSilence,
    "chiploss": ChipPowerLoss,
}
FAULT_NAMES = (*FRAME_FAULTS, *TIMED_FAULTS, "calm")


@dataclass(frozen=True)
class ScheduledFault:
    """A fault and its start time, s after the start of the board; 0: at once."""

    fault: Fault
    at: float = 0.0


def parse_fault(text: str) -> ScheduledFault:
    """Parses one fault in the syntax above. Raises `LrmError`."""
    words = text.split()
    at = 0.0
    if len(words) > 2 and words[-2] == "at":
        at = _number(text, words[-1], float)
        words = words[:-2]
    match words:
        case ["calm"]:
            return ScheduledFault(ClearFrameFaults(), at)
        case [name, seconds] if name in TIMED_FAULTS:
            return ScheduledFault(TIMED_FAULTS[name](_number(text, seconds, float)), at)
        case [name, "frame", number, *rest] if name in FRAME_FAULTS:
            frame = _number(text, number, int)
            return ScheduledFault(FrameFault(FRAME_FAULTS[name], frame=frame, direction=_direction(text, rest)), at)
        case [name, rate, *rest] if name in FRAME_FAULTS:
            share = _number(text, rate, float)
            if share > 1.0:
                raise LrmError(f"fault '{text}': {rate} is no rate; should be 0 to 1, or 'frame {rate}'")
            return ScheduledFault(FrameFault(FRAME_FAULTS[name], share, direction=_direction(text, rest)), at)
        case [name, *_] if name in FAULT_NAMES:
            right = "NAME RATE or NAME frame K, then in, out or both" if name in FRAME_FAULTS else "NAME SECONDS"
            raise LrmError(f"fault '{text}' is not complete; should be {right}, then perhaps 'at T'")
        case [name, *_]:
            raise LrmError(f"unknown fault '{name}'; {name_suggestion(name, FAULT_NAMES)}")
    raise LrmError(f"empty fault; valid: {', '.join(FAULT_NAMES)}")


def _number(text: str, word: str, kind: type[N]) -> N:
    try:
        value = kind(word)
    except ValueError:
        value = kind(-1)
    if not 0 <= value < 1e9:
        raise LrmError(f"fault '{text}': '{word}' should be a number, 0 or more")
    return value


def _direction(text: str, words: list[str]) -> Direction:
    direction = words[0] if words else "in"
    if len(words) > 1 or direction not in get_args(Direction):
        raise LrmError(f"fault '{text}': '{' '.join(words)}' should be one of {', '.join(get_args(Direction))}")
    return direction  # type: ignore[return-value]


class FaultyLine:
    """One direction of the link with frame faults. Splits the stream after each 0x00; buffers at most 64 bytes."""

    LONGEST = 64

    def __init__(self, direction: Literal["in", "out"], random: Random) -> None:
        self.direction = direction
        self.faults: list[FrameFault] = []
        self._random = random
        self._rest = b""
        self._number = 0

    def add_fault(self, fault: FrameFault) -> None:
        """Applies a fault to the following frames, if it concerns this direction."""
        if fault.direction in (self.direction, "both"):
            self.faults.append(fault)

    def transmit(self, data: bytes) -> bytes:
        """The bytes received now: whole frames, corrupted or not; anything longer than a frame at once."""
        *pieces, self._rest = (self._rest + data).split(b"\0")
        out = [self._corrupt(piece + b"\0") for piece in pieces]
        if len(self._rest) > self.LONGEST:
            out.append(self._rest)
            self._rest = b""
        return b"".join(out)

    def _corrupt(self, wire: bytes) -> bytes:
        self._number += 1
        for fault in self.faults:
            if fault.applies(self._number, self._random):
                wire = fault.corrupted(wire, self._random)
        return wire
