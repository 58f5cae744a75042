"""Faults of the link and of the board, as values: what `--fault` and the control socket understand.

flip | lose | double  RATE|frame K  [in|out|both]      frames on the line, to the board (in) or from it (out)
stall | hangup | brownout | chip  SECONDS              for a time
calm                                                   ends all rates
... at T                                               not now, but T s after the start, in the board's time
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from random import Random
from typing import Literal, TypeAlias, TypeVar, get_args

from lrm_math.errors import LrmError, nearest

N = TypeVar("N", int, float)
Way: TypeAlias = Literal["in", "out", "both"]


class FaultError(LrmError):
    """A fault that cannot be understood."""


@dataclass(frozen=True)
class FrameFault(ABC):
    """Spoils frames on the line: each with probability `rate`, or only number `frame` (from 1, since the start)."""

    rate: float = 0.0
    frame: int | None = None
    way: Way = "in"

    def hits(self, number: int, random: Random) -> bool:
        """Whether frame `number` is spoilt."""
        return number == self.frame if self.frame is not None else random.random() < self.rate

    @abstractmethod
    def spoilt(self, wire: bytes, random: Random) -> bytes:
        """What arrives instead of one frame; `wire` ends with its 0x00."""


class BitFlip(FrameFault):
    """One bit arrives the other way round, be it in the 0x00 at the end."""

    def spoilt(self, wire: bytes, random: Random) -> bytes:
        """The frame with one bit flipped."""
        bit = random.randrange(8 * len(wire))
        out = bytearray(wire)
        out[bit // 8] ^= 1 << bit % 8
        return bytes(out)


class LostFrames(FrameFault):
    """The frame does not arrive."""

    def spoilt(self, wire: bytes, random: Random) -> bytes:
        """Nothing."""
        return b""


class DoubledFrames(FrameFault):
    """The frame arrives twice."""

    def spoilt(self, wire: bytes, random: Random) -> bytes:
        """The frame, and again."""
        return wire + wire


@dataclass(frozen=True)
class TimedFault:
    """Something that lasts for a time (s, of the board's clock)."""

    seconds: float


class Stall(TimedFault):
    """The line stands still: bytes of both ways arrive late, all at once. The board runs on."""


class HangUp(TimedFault):
    """The device vanishes, as when the cable is drawn, and comes back as a new one. The board runs on."""


class BrownOut(TimedFault):
    """The board has no power: outputs off, everything forgotten, another boot number."""


class ChipSilence(TimedFault):
    """The PCA9685 does not acknowledge; its outputs stay as they are."""


@dataclass(frozen=True)
class Calm:
    """Ends all faults that have a rate or wait for a frame."""


Fault: TypeAlias = FrameFault | TimedFault | Calm

FRAME_FAULTS: dict[str, type[FrameFault]] = {"flip": BitFlip, "lose": LostFrames, "double": DoubledFrames}
TIMED_FAULTS: dict[str, type[TimedFault]] = {
    "stall": Stall,
    "hangup": HangUp,
    "brownout": BrownOut,
    "chip": ChipSilence,
}
FAULT_NAMES = (*FRAME_FAULTS, *TIMED_FAULTS, "calm")


@dataclass(frozen=True)
class Planned:
    """A fault and when it begins, s after the start; with 0, at once."""

    fault: Fault
    at: float = 0.0


def parse_fault(text: str) -> Planned:
    """One fault from words, see above. Raises `FaultError`."""
    words = text.split()
    at = 0.0
    if len(words) > 2 and words[-2] == "at":
        at = _number(text, words[-1], float)
        words = words[:-2]
    match words:
        case ["calm"]:
            return Planned(Calm(), at)
        case [name, seconds] if name in TIMED_FAULTS:
            return Planned(TIMED_FAULTS[name](_number(text, seconds, float)), at)
        case [name, "frame", number, *way] if name in FRAME_FAULTS:
            return Planned(FRAME_FAULTS[name](frame=_number(text, number, int), way=_way(text, way)), at)
        case [name, rate, *way] if name in FRAME_FAULTS:
            share = _number(text, rate, float)
            if share > 1.0:
                raise FaultError(f"fault '{text}': {rate} is no rate; should be 0 to 1, or 'frame {rate}'")
            return Planned(FRAME_FAULTS[name](rate=share, way=_way(text, way)), at)
        case [name, *_] if name in FAULT_NAMES:
            right = "NAME RATE or NAME frame K, then in, out or both" if name in FRAME_FAULTS else "NAME SECONDS"
            raise FaultError(f"fault '{text}' is not complete; should be {right}, then perhaps 'at T'")
        case [name, *_]:
            raise FaultError(f"unknown fault '{name}'; {nearest(name, FAULT_NAMES)}")
    raise FaultError(f"empty fault; valid: {', '.join(FAULT_NAMES)}")


def _number(text: str, word: str, kind: type[N]) -> N:
    try:
        value = kind(word)
    except ValueError:
        value = kind(-1)
    if not 0 <= value < 1e9:
        raise FaultError(f"fault '{text}': '{word}' should be a number, 0 or more")
    return value


def _way(text: str, words: list[str]) -> Way:
    way = words[0] if words else "in"
    if len(words) > 1 or way not in get_args(Way):
        raise FaultError(f"fault '{text}': '{' '.join(words)}' should be one of {', '.join(get_args(Way))}")
    return way  # type: ignore[return-value]


class Line:
    """One way of the link. Cuts the stream behind every 0x00 and lets faults at the pieces; keeps at most 64 bytes."""

    LONGEST = 64

    def __init__(self, way: Literal["in", "out"], random: Random) -> None:
        self.way = way
        self.faults: list[FrameFault] = []
        self._random = random
        self._rest = b""
        self._number = 0

    def take(self, fault: FrameFault) -> None:
        """Lets a fault at the frames to come, if it is one of this way."""
        if fault.way in (self.way, "both"):
            self.faults.append(fault)

    def carry(self, data: bytes) -> bytes:
        """What arrives of these bytes now: whole frames, spoilt or not; what is too long to be one, at once."""
        *pieces, self._rest = (self._rest + data).split(b"\0")
        out = [self._spoilt(piece + b"\0") for piece in pieces]
        if len(self._rest) > self.LONGEST:
            out.append(self._rest)
            self._rest = b""
        return b"".join(out)

    def _spoilt(self, wire: bytes) -> bytes:
        self._number += 1
        for fault in self.faults:
            if fault.hits(self._number, self._random):
                wire = fault.spoilt(wire, self._random)
        return wire
