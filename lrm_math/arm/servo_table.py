"""Level 1: joint angle <-> pulse <-> counts of the PCA9685, and the quantisation error.

Sources: piecewise linear table of Conenna 2024, section 3.4; registers and prescale of the NXP PCA9685 data sheet
(rev. 4, section 7.3.5). Thesis Eqs 3.1 and 3.2 are corrected: the chip's real frequency follows from the *rounded*
prescale, and the oscillator is a calibration value of each board (25 MHz nominal, 23 to 27 MHz seen).
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD, PRESCALE_MAX, PRESCALE_MIN
from lrm_math.arrays import Array
from lrm_math.errors import LrmError


@dataclass(frozen=True)
class ServoTable:
    """Calibration table of one servo: measured angles and the pulses that gave them, both strictly monotone.

    `angle`: rad, rising. `pulse`: s, strictly rising or strictly falling (a servo mounted in reverse).
    """

    angle: tuple[float, ...]
    pulse: tuple[float, ...]

    def __post_init__(self) -> None:
        steps = np.diff(self.pulse)
        if len(self.angle) != len(self.pulse) or len(self.angle) < 2:
            pairs = f"{len(self.angle)} angles and {len(self.pulse)} pulses"
            raise LrmError(f"servo table: {pairs}; needs two or more pairs")
        if not np.all(np.diff(self.angle) > 0):
            raise LrmError("servo table: angles must rise from entry to entry")
        if not (np.all(steps > 0) or np.all(steps < 0)):
            raise LrmError("servo table: pulses must all rise or all fall with the angle")

    def pulse_of(self, angle: ArrayLike) -> Array:
        """Pulse (s) for a joint angle (rad), linear between the measured points and beyond the last ones."""
        return _piecewise(angle, self.angle, self.pulse)

    def angle_of(self, pulse: ArrayLike) -> Array:
        """Joint angle (rad) for a pulse (s): the inverse of `pulse_of`."""
        order = slice(None) if self.pulse[0] < self.pulse[-1] else slice(None, None, -1)
        return _piecewise(pulse, self.pulse[order], self.angle[order])


def _piecewise(x: ArrayLike, knots: tuple[float, ...], values: tuple[float, ...]) -> Array:
    """Piecewise linear interpolation and extrapolation, knots rising; plain Python is faster for one number."""
    if isinstance(x, float):
        k = min(max(bisect_right(knots, x) - 1, 0), len(knots) - 2)
        slope = (values[k + 1] - values[k]) / (knots[k + 1] - knots[k])
        return np.asarray(values[k] + slope * (x - knots[k]))
    at, ends, y = np.asarray(x, dtype=np.float64), np.array(knots), np.array(values)
    piece = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(ends) - 2)
    slopes = np.diff(y) / np.diff(ends)
    return np.asarray(y[piece] + slopes[piece] * (at - ends[piece]))


@dataclass(frozen=True)
class PwmClock:
    """The clock of one PCA9685: its prescale register and the time that one count lasts.

    `frequency_hz` is the nominal PWM frequency, `oscillator_hz` the board's own oscillator as calibrated.
    Raises `LrmError` if the prescale does not fit the chip (3 to 255).
    """

    frequency_hz: float
    oscillator_hz: float = 25e6

    def __post_init__(self) -> None:
        if not (self.frequency_hz > 0 and self.oscillator_hz > 0):
            raise LrmError(f"frequency {self.frequency_hz} Hz and oscillator {self.oscillator_hz} Hz must be positive")
        if not PRESCALE_MIN <= self.prescale <= PRESCALE_MAX:
            low = self.oscillator_hz / COUNTS_PER_PERIOD / (PRESCALE_MAX + 1)
            high = self.oscillator_hz / COUNTS_PER_PERIOD / (PRESCALE_MIN + 1)
            raise LrmError(
                f"PWM frequency {self.frequency_hz} Hz needs prescale {self.prescale}; "
                f"this board reaches {low:.1f} to {high:.0f} Hz"
            )

    @property
    def prescale(self) -> int:
        """The register value: round(oscillator / (4096 · frequency)) − 1 (data sheet, Equation 1)."""
        return int(np.floor(self.oscillator_hz / (COUNTS_PER_PERIOD * self.frequency_hz) + 0.5)) - 1

    @property
    def count_s(self) -> float:
        """Duration of one count in seconds, with the rounded prescale: (prescale + 1) / oscillator."""
        return (self.prescale + 1) / self.oscillator_hz

    def counts_of(self, pulse: ArrayLike) -> NDArray[np.int64]:
        """OFF counts (0 to 4095) nearest to a pulse (s). Raises `LrmError` if the pulse does not fit."""
        counts = np.floor(np.asarray(pulse, dtype=np.float64) / self.count_s + 0.5)
        if not np.all((counts >= 0) & (counts < COUNTS_PER_PERIOD)):
            longest = (COUNTS_PER_PERIOD - 1) * self.count_s * 1e6
            frequency = 1.0 / (COUNTS_PER_PERIOD * self.count_s)
            raise LrmError(f"pulse outside 0 to {longest:.0f} us of a {frequency:.1f} Hz period")
        return counts.astype(np.int64)

    def pulse_of(self, counts: ArrayLike) -> Array:
        """Pulse (s) of a number of counts."""
        return np.asarray(counts, dtype=np.float64) * self.count_s


def rounding(table: ServoTable, clock: PwmClock, angle: ArrayLike) -> Array:
    """Joint angle error (rad) of rounding to counts: output minus commanded angle, shape of `angle`."""
    commanded = np.asarray(angle, dtype=np.float64)
    return table.angle_of(clock.pulse_of(clock.counts_of(table.pulse_of(commanded)))) - commanded
