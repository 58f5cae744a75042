"""Simulated servo board: handles frames, drives the chip model, and stops the pulses on a silence timeout.

Sans-io: bytes and times (ns) are arguments. Specification: docs/protocol.md; firmware/ is its counterpart on hardware.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from random import Random
from typing import Final, TypeAlias

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD, PRESCALE_MAX, PRESCALE_MIN
from lrmd.link import pca9685, protocol
from lrmd.link.frames import BadFrame, Frame, FrameDecoder, FrameType, bits_of, encode
from lrmd.link.pca9685 import RegisterError
from lrmd.link.protocol import BoardInfo, BoardStatus, ErrorCode
from lrmd.sim.pca9685_chip import I2cNoAcknowledge, Pca9685Chip

MS: Final = 1_000_000
WORD: Final = 0x10000
SIMULATED: Final = 1
RETRY: Final = 10 * MS
ALL_CHANNELS: Final = 0xFFFF
ASLEEP: Final = bytes((pca9685.AUTO_INCREMENT | pca9685.SLEEP,))
SETUP_LIMITS: Final = {0: (PRESCALE_MIN, PRESCALE_MAX), 1: (protocol.SILENCE_MS_MIN, protocol.SILENCE_MS_MAX)}

FrameListener: TypeAlias = Callable[[int, str, Mapping[int, int]], None]
"""Callback of (time in ns, `arm` | `setup` | `silence` | `power`, words by channel or by bit)."""


class FrameRefused(Exception):
    """A frame that is answered by ERROR and has no effect."""

    def __init__(self, code: ErrorCode, index: int = 0) -> None:
        self.code, self.index = code, index


class SimulatedBoard:
    """One board with its chip.

    Args:
        chip: owned by the board from now on.
        random: draws the boot numbers.
        now: ns, when the power comes on. Times given later never go back.

    Attributes:
        listener: called on every accepted ARM and SETUP, stop on silence and power-on.
    """

    def __init__(self, chip: Pca9685Chip, random: Random, now: int = 0) -> None:
        self.chip = chip
        self.listener: FrameListener = lambda *_: None
        self._random = random
        self.power_cycle(now)

    def power_cycle(self, now: int) -> None:
        """Power lost and restored: state cleared, all outputs off, new boot number."""
        self.chip.power_cycle()
        self._decoder = FrameDecoder()
        self.boot = self._new_boot_number()
        self.accepted = self.refused = 0
        self.silence_ms = protocol.SILENCE_MS_DEFAULT
        self._silenced = self._fault = self._set_up = False
        self._outputs = ALL_CHANNELS
        self._last_arm = now - self.silence_ms * MS
        self._last_tick = now
        self._stop(now)
        self.listener(now, "power", {})

    def _new_boot_number(self) -> int:
        while (number := self._random.randint(1, WORD - 1)) == getattr(self, "boot", 0):
            pass
        return number

    @property
    def status(self) -> BoardStatus:
        """The status word of ACK and INFO."""
        return BoardStatus(bool(self._outputs) | self._silenced << 1 | self._fault << 2 | self._set_up << 3)

    @property
    def deadline(self) -> int | None:
        """Latest time (ns) of the next `tick`, None while nothing pulses."""
        return max(self._last_arm + self.silence_ms * MS, self._last_tick + RETRY) if self._outputs else None

    def tick(self, now: int) -> None:
        """Stops all outputs if no ARM frame was accepted for the silence timeout; retries until the chip answers.

        The stop is latched: ARM is refused until the next SETUP.
        """
        self._last_tick = now
        if self._overdue(now) and self._stop(now):
            self._silenced, self._set_up = self._silenced or self._set_up, False
            self.listener(now, "silence", {})

    def _overdue(self, now: int) -> bool:
        return bool(self._outputs) and now - self._last_arm >= self.silence_ms * MS

    def _stop(self, now: int) -> bool:
        """All outputs off; before the first SETUP the chip sleeps, too. Returns whether the chip acknowledged."""
        self.chip.enable(False)
        try:
            self._write((pca9685.ALL_OFF,), now)
            if not self._set_up:
                self._write((pca9685.RegisterWrite(pca9685.MODE1, ASLEEP),), now)
        except I2cNoAcknowledge:
            self._fault = True
            return False
        self._outputs, self._fault = 0, False
        return True

    def feed(self, data: bytes, now: int) -> bytes:
        """Handles received bytes; returns the bytes to send back."""
        return b"".join([self._reply(event, now) for event in self._decoder.feed(data)])

    def _reply(self, event: Frame | BadFrame, now: int) -> bytes:
        self.tick(now)
        if isinstance(event, BadFrame):
            self.refused += 1
            return encode(protocol.error_to(event))
        try:
            reply = self._execute(event, now)
        except FrameRefused as refused:
            self.refused += 1
            reply = protocol.error(event.seq, refused.code, refused.index)
        except (I2cNoAcknowledge, RegisterError):
            self.refused += 1
            self._fault = True
            reply = protocol.error(event.seq, ErrorCode.CHIP)
        return encode(reply)

    def _execute(self, frame: Frame, now: int) -> Frame:
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
                raise FrameRefused(ErrorCode.UNKNOWN_TYPE)
        self.accepted += 1
        return protocol.ack(frame.seq, self.status, self.boot)

    def _arm(self, frame: Frame, now: int) -> None:
        counts = frame.word_by_bit()
        for channel, count in counts.items():
            if count >= COUNTS_PER_PERIOD:
                raise FrameRefused(ErrorCode.VALUE, channel)
        if not self._set_up:
            raise FrameRefused(ErrorCode.NOT_SET_UP)
        self._require_mode1(pca9685.AUTO_INCREMENT | pca9685.SLEEP)
        if self._overdue(now):
            raise I2cNoAcknowledge("outputs that were due to stop could not be stopped")
        switched_on = sum(1 << channel for channel, count in counts.items() if count)
        on = self._outputs & ~frame.mask | switched_on
        self._outputs |= on
        self._write(pca9685.channel_writes(counts), now)
        self._outputs, self._last_arm, self._fault = on, now, False
        self.chip.enable(bool(on))
        self.listener(now, "arm", counts)

    def _setup(self, frame: Frame, now: int) -> None:
        words = frame.word_by_bit()
        for bit, word in words.items():
            low, high = SETUP_LIMITS.get(bit, (1, 0))
            if not low <= word <= high:
                raise FrameRefused(ErrorCode.VALUE, bit)
        if 0 in words:
            self._start_chip(words[0], now)
            self._set_up = True
        self.silence_ms = words.get(1, self.silence_ms)
        self._silenced = False
        self.listener(now, "setup", words)

    def _start_chip(self, prescale: int, now: int) -> None:
        """Sets the prescale, unless the chip runs with it: then it goes on pulsing. Raises `I2cNoAcknowledge`."""
        mode1, before = self.chip.read(pca9685.MODE1)[0], self.chip.read(pca9685.PRESCALE)[0]
        if not pca9685.is_running(mode1, before, prescale):
            if not self._stop(now):
                raise I2cNoAcknowledge("outputs could not be stopped")
            self._write(pca9685.start_sequence(prescale), now)

    def _state(self, frame: Frame) -> Frame:
        self._require_mode1(pca9685.AUTO_INCREMENT)
        counts = {channel: self._count(channel) for channel in bits_of(frame.mask)}
        self.accepted += 1
        return protocol.state(frame.seq, counts)

    def _count(self, channel: int) -> int:
        return pca9685.counts_of(self.chip.read(pca9685.channel_register(channel), pca9685.CHANNEL_BYTES))

    def _info(self, frame: Frame) -> Frame:
        if frame.mask:
            raise FrameRefused(ErrorCode.VALUE, bits_of(frame.mask)[0])
        prescale = self.chip.read(pca9685.PRESCALE)[0]
        self.accepted += 1
        counters = self.accepted % WORD, self.refused % WORD
        info = BoardInfo(protocol.VERSION, self.boot, self.status, prescale, self.silence_ms, *counters, SIMULATED)
        return protocol.info(frame.seq, info)

    def _require_mode1(self, bits: int) -> None:
        """Raises `I2cNoAcknowledge` unless AUTO_INCREMENT is the only one of these MODE1 bits set."""
        if self.chip.read(pca9685.MODE1)[0] & bits != pca9685.AUTO_INCREMENT:
            raise I2cNoAcknowledge("the chip was reset: it needs a SETUP")

    def _write(self, steps: Iterable[pca9685.RegisterWrite | pca9685.BusPause], now: int) -> None:
        for step in steps:
            if isinstance(step, pca9685.BusPause):
                now += round(step.seconds * 1e9)
            else:
                self.chip.write(step.register, step.data, now)
