"""Register-level model of the PCA9685 PWM chip: registers, sleep and restart, and output pulses.

Source: NXP PCA9685 data sheet, rev. 4, sections 7.3.1 to 7.3.5 and Table 4. Left out: sub-addresses, software reset,
external clock, inverted outputs (INVRT), outputs that change before the stop (OCH). One call is one transaction.
"""

from __future__ import annotations

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD
from lrm_math.errors import LrmError
from lrmd.link.pca9685 import (
    ALL_OFF_H,
    ALL_ON_L,
    AUTO_INCREMENT,
    CHANNEL_BYTES,
    CHANNELS,
    FULL,
    LED0,
    MODE1,
    MODE2,
    OSCILLATOR_START_S,
    PRESCALE,
    RESET_MODE1,
    RESET_MODE2,
    RESET_PRESCALE,
    RESTART,
    SLEEP,
)

REGISTERS = 256
LED_END = LED0 + CHANNEL_BYTES * CHANNELS
PRESCALE_LOWEST = 3
EXTERNAL_CLOCK = 0x40
START_NS = round(OSCILLATOR_START_S * 1e9)
_CHANNEL_AT_RESET = bytes((0, 0, 0, FULL))
_WRITABLE = bytes((0xFF, 0x1F, 0xFF, 0x1F))
"""Bits of ON_L, ON_H, OFF_L, OFF_H that exist."""
_WRITABLE_LED = _WRITABLE * CHANNELS


class I2cNoAcknowledge(LrmError):
    """No I2C acknowledge: the chip has no power, or no such register."""


class Pca9685Chip:
    """One chip. `oscillator_hz`: its internal oscillator, nominally 25 MHz, 23 to 27 MHz on real chips.

    `changes` increases whenever outputs may have changed. Times are ns of a monotonic clock.
    """

    def __init__(self, oscillator_hz: float = 25e6) -> None:
        if not 20e6 <= oscillator_hz <= 30e6:
            raise LrmError(f"oscillator {oscillator_hz:g} Hz; real chips lie between 23e6 and 27e6")
        self.oscillator_hz = oscillator_hz
        self.answers = True
        self.enabled = True
        self.changes = 0
        self._registers = bytearray(REGISTERS)
        self._woken = 0
        self.power_cycle()

    def power_cycle(self) -> None:
        """All registers as after power-on: asleep, 200 Hz, every output fully off (Table 4)."""
        self._registers[:] = bytes(REGISTERS)
        self._registers[MODE1], self._registers[MODE2] = RESET_MODE1, RESET_MODE2
        self._registers[PRESCALE] = RESET_PRESCALE
        self._registers[LED0:LED_END] = _CHANNEL_AT_RESET * CHANNELS
        self.changes += 1

    def write(self, register: int, data: bytes, now: int) -> None:
        """Writes `data` from `register` on; what it does to the outputs shows when all of it is in.

        Raises:
            NoAnswer: the chip is dead, or the register does not exist (Table 4); what came before it is written.
        """
        self.changes += 1
        within = register >= LED0 and register + len(data) <= LED_END
        if within and self.answers and self._registers[MODE1] & AUTO_INCREMENT:
            self._store_channels(register, data)
            return
        for byte in data:
            self._check(register)
            self._store(register, byte, now)
            register = self._after(register)

    def read(self, register: int, length: int = 1) -> bytes:
        """`length` bytes from `register` on. Raises `I2cNoAcknowledge`."""
        out = bytearray()
        for _ in range(length):
            self._check(register)
            out.append(self._registers[register])
            register = self._after(register)
        return bytes(out)

    def enable(self, on: bool) -> None:
        """The pin OE: enables the outputs, or holds all of them low (7.4)."""
        if on != self.enabled:
            self.enabled = on
            self.changes += 1

    def width(self, channel: int) -> int | None:
        """Counts of the channel's high time per period; None without pulses (off, or always on).

        Full off overrides full on (7.3.3); ON after OFF wraps around the period; equal ones never switch on.
        """
        if not self.enabled or self._registers[MODE1] & (SLEEP | RESTART):
            return None
        return self._high(channel)

    @property
    def count_s(self) -> float:
        """Duration of one count (s): (prescale + 1) / oscillator (7.3.5)."""
        return (self._registers[PRESCALE] + 1) / self.oscillator_hz

    def pulse(self, channel: int) -> float | None:
        """Pulse width (s) of the channel, None without pulses."""
        width = self.width(channel)
        return None if width is None else width * self.count_s

    def _check(self, register: int) -> None:
        if not self.answers:
            raise I2cNoAcknowledge("the PCA9685 does not answer")
        if not (0 <= register < LED_END or ALL_ON_L <= register <= PRESCALE):
            raise I2cNoAcknowledge(f"the PCA9685 has no register {register:#04x}")

    def _after(self, register: int) -> int:
        """The next address: past the channels, and past PRE_SCALE, comes MODE1 (Table 4, remark)."""
        if not self._registers[MODE1] & AUTO_INCREMENT:
            return register
        return 0 if register in (LED_END - 1, PRESCALE) else register + 1

    def _store(self, register: int, byte: int, now: int) -> None:
        if LED0 <= register < LED_END:
            self._store_channels(register, bytes((byte,)))
        elif ALL_ON_L <= register <= ALL_OFF_H:
            part = register - ALL_ON_L
            self._registers[LED0 + part : LED_END : CHANNEL_BYTES] = bytes((byte & _WRITABLE[part],)) * CHANNELS
            self._registers[MODE1] &= ~RESTART
        elif register == PRESCALE:
            if self._registers[MODE1] & SLEEP:
                self._registers[PRESCALE] = max(byte, PRESCALE_LOWEST)
        elif register == MODE1:
            self._registers[MODE1] = self._mode1(self._registers[MODE1], byte, now)
        else:
            self._registers[register] = byte

    def _store_channels(self, register: int, data: bytes) -> None:
        """Writing any of these registers also clears RESTART (7.3.1.1)."""
        at, end = register - LED0, register - LED0 + len(data)
        kept = int.from_bytes(data, "big") & int.from_bytes(_WRITABLE_LED[at:end], "big")
        self._registers[register : register + len(data)] = kept.to_bytes(len(data), "big")
        self._registers[MODE1] &= ~RESTART

    def _mode1(self, before: int, wanted: int, now: int) -> int:
        """MODE1 after a write (7.3.1): RESTART remembers that channels were on when the chip fell asleep.

        A 1 written to it clears it, once the oscillator has run for 500 us; until then no channel restarts.
        """
        if before & SLEEP and not wanted & SLEEP:
            self._woken = now
        falls_asleep = wanted & SLEEP and not before & SLEEP
        on = any(self._high(channel) for channel in range(CHANNELS))
        pending = on if falls_asleep else bool(before & RESTART)
        runs = not (before | wanted) & SLEEP and now - self._woken >= START_NS
        if wanted & RESTART and runs:
            pending = False
        return wanted & ~(RESTART | EXTERNAL_CLOCK) | (RESTART if pending else 0)

    def _high(self, channel: int) -> int | None:
        at = LED0 + CHANNEL_BYTES * channel
        on_low, on_high, off_low, off_high = self._registers[at : at + CHANNEL_BYTES]
        if (on_high | off_high) & FULL:
            return None
        return ((off_high << 8 | off_low) - (on_high << 8 | on_low)) % COUNTS_PER_PERIOD or None
