"""The servo board without hardware: frames in, frames out, the chip behind it, and the stop on silence.

Sans-io: bytes and times (ns) are arguments. The contract is docs/protocol.md; firmware/ is the same for a real board.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from random import Random
from typing import Final, TypeAlias

from lrm_math.arm.servo_table import COUNTS_PER_PERIOD, PRESCALE_MAX, PRESCALE_MIN
from lrmd.link import pca9685, protocol
from lrmd.link.pca9685 import RegisterError
from lrmd.link.protocol import Bad, Decoder, ErrorCode, Frame, FrameType, Info, Status
from lrmd.sim.pca9685_chip import NoAnswer, Pca9685Chip

MS: Final = 1_000_000
WORD: Final = 0x10000
SIMULATED: Final = 1
RETRY: Final = 10 * MS
ALL_CHANNELS: Final = 0xFFFF
ASLEEP: Final = bytes((pca9685.AUTO_INCREMENT | pca9685.SLEEP,))
SETUP_LIMITS: Final = {0: (PRESCALE_MIN, PRESCALE_MAX), 1: (protocol.SILENCE_MS_MIN, protocol.SILENCE_MS_MAX)}

Listener: TypeAlias = Callable[[int, str, Mapping[int, int]], None]
"""Is told of (time in ns, `arm` | `setup` | `silence` | `power`, words by channel or by bit)."""


def _nobody(*_: object) -> None:
    return None


class Refused(Exception):
    """A frame that is answered by ERROR and has had no effect."""

    def __init__(self, code: ErrorCode, index: int = 0) -> None:
        self.code, self.index = code, index


class Board:
    """One board with its chip.

    Args:
        chip: stays the board's own from now on.
        random: draws the boot numbers.
        now: ns, when the power comes on. Times given later never go back.

    Attributes:
        listener: is told of every accepted ARM and SETUP, of every stop on silence and every power-on.
    """

    def __init__(self, chip: Pca9685Chip, random: Random, now: int = 0) -> None:
        self.chip = chip
        self.listener: Listener = _nobody
        self._random = random
        self.power_cycle(now)

    def power_cycle(self, now: int) -> None:
        """Power lost and back: everything forgotten, all outputs off, another boot number."""
        self.chip.power_cycle()
        self._decoder = Decoder()
        self.boot = self._another_boot()
        self.accepted = self.refused = 0
        self.silence_ms = protocol.SILENCE_MS_DEFAULT
        self._silenced = self._fault = self._set_up = False
        self._on = ALL_CHANNELS
        self._heard = now - self.silence_ms * MS
        self._tried = now
        self._stop(now)
        self.listener(now, "power", {})

    def _another_boot(self) -> int:
        before = getattr(self, "boot", 0)
        while (number := self._random.randint(1, WORD - 1)) == before:
            pass
        return number

    @property
    def status(self) -> Status:
        """The state as ACK and INFO tell it."""
        return Status(bool(self._on) | self._silenced << 1 | self._fault << 2 | self._set_up << 3)

    @property
    def deadline(self) -> int | None:
        """When `tick` has to be called at the latest (ns), or None as long as nothing pulses."""
        return max(self._heard + self.silence_ms * MS, self._tried + RETRY) if self._on else None

    def tick(self, now: int) -> None:
        """Stops all outputs if no ARM frame was accepted for the silence timeout; retries until the chip answers.

        The stop is latched: ARM is refused until the next SETUP.
        """
        self._tried = now
        if self._overdue(now) and self._stop(now):
            self._silenced, self._set_up = self._silenced or self._set_up, False
            self.listener(now, "silence", {})

    def _overdue(self, now: int) -> bool:
        return bool(self._on) and now - self._heard >= self.silence_ms * MS

    def _stop(self, now: int) -> bool:
        """All outputs off; before the first SETUP the chip sleeps, too. Returns whether the chip acknowledged."""
        self.chip.enable(False)
        try:
            self._write((pca9685.ALL_OFF,), now)
            if not self._set_up:
                self._write((pca9685.Write(pca9685.MODE1, ASLEEP),), now)
        except NoAnswer:
            self._fault = True
            return False
        self._on, self._fault = 0, False
        return True

    def feed(self, data: bytes, now: int) -> bytes:
        """Takes what came over the line; returns what goes back."""
        return b"".join([self._answer(event, now) for event in self._decoder.feed(data)])

    def _answer(self, event: Frame | Bad, now: int) -> bytes:
        self.tick(now)
        if isinstance(event, Bad):
            self.refused += 1
            return protocol.encode(protocol.error_to(event))
        try:
            reply = self._obey(event, now)
        except Refused as refused:
            self.refused += 1
            reply = protocol.error(event.seq, refused.code, refused.index)
        except (NoAnswer, RegisterError):
            self.refused += 1
            self._fault = True
            reply = protocol.error(event.seq, ErrorCode.CHIP)
        return protocol.encode(reply)

    def _obey(self, frame: Frame, now: int) -> Frame:
        match frame.type:
            case FrameType.ARM:
                self._arm(frame, now)
            case FrameType.SETUP:
                self._setup(frame, now)
            case FrameType.READ:
                return self._state(frame)
            case FrameType.HELLO:
                return self._info(frame)
            case _:
                raise Refused(ErrorCode.UNKNOWN_TYPE)
        self.accepted += 1
        return protocol.ack(frame.seq, self.status, self.boot)

    def _arm(self, frame: Frame, now: int) -> None:
        counts = frame.items()
        for channel, count in counts.items():
            if count >= COUNTS_PER_PERIOD:
                raise Refused(ErrorCode.VALUE, channel)
        if not self._set_up:
            raise Refused(ErrorCode.NOT_SET_UP)
        self._need(pca9685.AUTO_INCREMENT | pca9685.SLEEP)
        if self._overdue(now):
            raise NoAnswer("outputs that were due to stop could not be stopped")
        switched_on = sum(1 << channel for channel, count in counts.items() if count)
        on = self._on & ~frame.mask | switched_on
        self._on |= on
        self._write(pca9685.channel_writes(counts), now)
        self._on, self._heard, self._fault = on, now, False
        self.chip.enable(bool(on))
        self.listener(now, "arm", counts)

    def _setup(self, frame: Frame, now: int) -> None:
        words = frame.items()
        for bit, word in words.items():
            low, high = SETUP_LIMITS.get(bit, (1, 0))
            if not low <= word <= high:
                raise Refused(ErrorCode.VALUE, bit)
        if 0 in words:
            self._start_chip(words[0], now)
            self._set_up = True
        self.silence_ms = words.get(1, self.silence_ms)
        self._silenced = False
        self.listener(now, "setup", words)

    def _start_chip(self, prescale: int, now: int) -> None:
        """Sets the prescale, unless the chip runs with it: then it goes on pulsing. Raises `NoAnswer`."""
        mode1, before = self.chip.read(pca9685.MODE1)[0], self.chip.read(pca9685.PRESCALE)[0]
        if not pca9685.is_running(mode1, before, prescale):
            if not self._stop(now):
                raise NoAnswer("outputs could not be stopped")
            self._write(pca9685.start_sequence(prescale), now)

    def _state(self, frame: Frame) -> Frame:
        self._need(pca9685.AUTO_INCREMENT)
        counts = {channel: self._count(channel) for channel in protocol.bits_of(frame.mask)}
        self.accepted += 1
        return protocol.state(frame.seq, counts)

    def _count(self, channel: int) -> int:
        return pca9685.counts_of(self.chip.read(pca9685.channel_register(channel), pca9685.CHANNEL_BYTES))

    def _info(self, frame: Frame) -> Frame:
        if frame.mask:
            raise Refused(ErrorCode.VALUE, protocol.bits_of(frame.mask)[0])
        prescale = self.chip.read(pca9685.PRESCALE)[0]
        self.accepted += 1
        accepted, refused = self.accepted % WORD, self.refused % WORD
        said = Info(protocol.VERSION, self.boot, self.status, prescale, self.silence_ms, accepted, refused, SIMULATED)
        return protocol.info(frame.seq, said)

    def _need(self, bits: int) -> None:
        """Raises `NoAnswer` unless, of these bits of MODE1, AUTO_INCREMENT alone is set: else the chip was reset."""
        if self.chip.read(pca9685.MODE1)[0] & bits != pca9685.AUTO_INCREMENT:
            raise NoAnswer("the chip was reset: it needs a SETUP")

    def _write(self, steps: Iterable[pca9685.Write | pca9685.Pause], now: int) -> None:
        for step in steps:
            if isinstance(step, pca9685.Pause):
                now += round(step.seconds * 1e9)
            else:
                self.chip.write(step.register, step.data, now)
