"""Register map of the PCA9685 PWM chip, as data: sequences of writes, and decoding of what was read. Sans-io.

Source: NXP PCA9685 data sheet, rev. 4: register map 7.3, MODE1 and RESTART 7.3.1, MODE2 7.3.2, channels 7.3.3,
ALL_LED 7.3.4, PRE_SCALE 7.3.5. Counts and prescale come from `lrm_math.arm.servo_table.PwmClock`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD, PRESCALE_MAX, PRESCALE_MIN
from lrm_math.errors import LrmError

CHANNELS: Final = 16
CHANNEL_BYTES: Final = 4

MODE1, MODE2, LED0, PRESCALE = 0x00, 0x01, 0x06, 0xFE
ALL_ON_L, ALL_ON_H, ALL_OFF_L, ALL_OFF_H = 0xFA, 0xFB, 0xFC, 0xFD

RESTART, AUTO_INCREMENT, SLEEP, ALL_CALL = 0x80, 0x20, 0x10, 0x01
TOTEM_POLE: Final = 0x04
FULL: Final = 0x10

RESET_MODE1, RESET_MODE2, RESET_PRESCALE = SLEEP | ALL_CALL, TOTEM_POLE, 0x1E
OSCILLATOR_START_S: Final = 500e-6


class RegisterError(LrmError):
    """Value outside a register's range, or register content that this software never writes."""


@dataclass(frozen=True, slots=True)
class RegisterWrite:
    """One bus transaction: `data` into `register` and, with auto-increment, the following ones."""

    register: int
    data: bytes


@dataclass(frozen=True, slots=True)
class BusPause:
    """Minimum delay before the next transaction."""

    seconds: float


ALL_OFF: Final = RegisterWrite(ALL_OFF_H, bytes((FULL,)))
"""Stops every output. One byte, so it needs no auto-increment; it overrides any other bit."""


def channel_register(channel: int) -> int:
    """Address of LEDn_ON_L. Raises `RegisterError` beyond channel 15."""
    if not 0 <= channel < CHANNELS:
        raise RegisterError(f"channel {channel}: the chip has 0 to {CHANNELS - 1}")
    return LED0 + CHANNEL_BYTES * channel


def channel_bytes(count: int) -> bytes:
    """ON_L, ON_H, OFF_L, OFF_H of a pulse of `count` counts (1 to 4095) from the start of the period; 0 = full off."""
    if not 0 <= count < COUNTS_PER_PERIOD:
        raise RegisterError(f"count {count}: a pulse has 1 to {COUNTS_PER_PERIOD - 1} counts, 0 is off")
    return bytes((0, 0, count & 0xFF, count >> 8)) if count else bytes((0, 0, 0, FULL))


def counts_of(data: bytes) -> int:
    """Counts of a channel from its four registers; 0 = full off, whose bit overrides all others (7.3.3).

    Raises `RegisterError` on registers that `channel_bytes` never gives: full on, a late start, or a width of zero.
    """
    if len(data) != CHANNEL_BYTES:
        raise RegisterError(f"{len(data)} bytes of a channel; it has {CHANNEL_BYTES}")
    if data[3] & FULL:
        return 0
    count = (data[3] & 0x0F) << 8 | data[2]
    if data[0] or data[1] & 0x1F or not count:
        raise RegisterError(f"channel registers {data.hex(' ')}: not a pulse that starts with the period")
    return count


def channel_writes(counts: Mapping[int, int]) -> tuple[RegisterWrite, ...]:
    """Transactions that set these channels; adjacent channels share one, so that their outputs change together.

    Needs auto-increment. Raises `RegisterError` before anything is written.
    """
    channels = sorted(counts)
    cuts = [0, *(i + 1 for i, (a, b) in enumerate(pairwise(channels)) if b != a + 1), len(channels)]
    runs = [channels[start:end] for start, end in pairwise(cuts) if end > start]
    data = [b"".join(channel_bytes(counts[channel]) for channel in run) for run in runs]
    return tuple(RegisterWrite(channel_register(run[0]), some) for run, some in zip(runs, data, strict=True))


def is_running(mode1: int, prescale: int, wanted: int) -> bool:
    """Whether a chip with these registers is awake, auto-increments and has the wanted prescale."""
    return mode1 & (SLEEP | AUTO_INCREMENT) == AUTO_INCREMENT and prescale == wanted


def start_sequence(prescale: int) -> tuple[RegisterWrite | BusPause, ...]:
    """Writes from any state to awake with this prescale, auto-increment and all outputs off. Raises `RegisterError`."""
    if not PRESCALE_MIN <= prescale <= PRESCALE_MAX:
        raise RegisterError(f"prescale {prescale}: the chip takes {PRESCALE_MIN} to {PRESCALE_MAX}")
    return (
        ALL_OFF,
        RegisterWrite(MODE1, bytes((AUTO_INCREMENT | SLEEP,))),
        RegisterWrite(PRESCALE, bytes((prescale,))),
        RegisterWrite(MODE2, bytes((TOTEM_POLE,))),
        RegisterWrite(MODE1, bytes((AUTO_INCREMENT,))),
        BusPause(OSCILLATOR_START_S),
        RegisterWrite(MODE1, bytes((RESTART | AUTO_INCREMENT,))),
    )
