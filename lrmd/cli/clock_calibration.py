"""The true oscillator of the board's PCA9685, from one pulse that is measured or two angles that are read off.

The board counts pulses in periods of its own oscillator, nominally 25 MHz, 23 to 27 MHz on real chips (PCA9685 data
sheet, Equation 1). A pulse that is configured for `f` and counted by `g` lasts f/g times as long: so does the period.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD
from lrm_math.arm.servo_table import ServoTable
from lrm_math.errors import LrmError
from lrmd.cli.parsing import parse_angle
from lrmd.cli.servo_calibration import CalibrationAborted
from lrmd.client import MotionInterrupted, Rover

SLOWEST_HZ, FASTEST_HZ = 20e6, 30e6
"""Bounds of `oscillator_hz` in `lrmd.toml`."""
TYPICAL_HZ = (23e6, 27e6)
"""Real chips."""
READING = math.radians(1.0)
"""rad: how far off an angle may be that is read off a protractor."""
TABLE = 0.02
"""Share by which the pulses of a servo's table may be off for a turn: servos of one kind differ by so much."""
SMALLEST_TURN = math.radians(30.0)
"""rad between two angles: below it a degree on the protractor is more than what is measured."""
COARSEST = 0.04
"""Relative uncertainty from which a value tells nothing: half of what real chips are off."""
HELP = """\
  1389us, 18.52ms, 54.0Hz   length of a pulse, period, or frequency at the servo's signal pin
  18.52ms +- 0.01           the same with its uncertainty (otherwise one of the last digit)
  ENTER                     no instrument: two angles on a protractor
  q                         stop"""

Prompt = Callable[[str], str]
Show = Callable[[str], None]


@dataclass(frozen=True)
class Oscillator:
    """A measured oscillator (Hz) and its uncertainty (Hz)."""

    hz: float
    uncertainty_hz: float


@dataclass(frozen=True)
class ClockedServo:
    """A servo behind a clock that is configured to `configured_hz`, and lets a count last `count_s` then.

    `limits`: rad, of commands.
    """

    name: str
    table: ServoTable
    limits: tuple[float, float]
    configured_hz: float
    count_s: float

    @classmethod
    def of(cls, rover: Rover, name: str) -> ClockedServo:
        """A servo of a daemon. Raises `LrmError` if it has none of this name."""
        info = rover.info()
        if name not in info.names:
            raise LrmError(f"unknown servo '{name}'; valid: {', '.join(info.names)}")
        i = info.names.index(name)
        table = ServoTable(tuple(info.tables_rad[i]), tuple(p * 1e-6 for p in info.tables_us[i]))
        low, high = info.limits_rad[i]
        return cls(name, table, (low, high), info.oscillator_hz, info.count_us * 1e-6)

    def put_out(self, pulse_s: float) -> float:
        """Pulse (s) that would come out of an oscillator as configured: whole counts."""
        return math.floor(pulse_s / self.count_s + 0.5) * self.count_s

    def angle_at(self, pulse_s: float, hz: float) -> float:
        """Angle (rad) of the shaft when a pulse of the configured clock is counted by an oscillator of `hz`."""
        return float(self.table.angle_of(pulse_s * self.configured_hz / hz))

    def reached(self, angle: float) -> tuple[float, float]:
        """Least and greatest angle (rad) where the shaft may stand when it is told one (rad), with real chips."""
        pulse = float(self.table.pulse_of(angle))
        ends = sorted(self.angle_at(pulse, hz) for hz in TYPICAL_HZ)
        return min(angle, ends[0]), max(angle, ends[1])


def calibrate_clock(rover: Rover, servo: str, prompt: Prompt = input, show: Show = print) -> Oscillator:
    """Guides the operator through the measurement and shows the line for `lrmd.toml`. Raises `LrmError`."""
    clocked = ClockedServo.of(rover, servo)
    _switch_on(rover, clocked, prompt, show)
    pulse = clocked.put_out(_pulse_s(rover, servo))
    show(f"{servo} gets pulses of {pulse * 1e6:.1f} us every {COUNTS_PER_PERIOD * clocked.count_s * 1e3:.3f} ms, if "
         f"the oscillator has {clocked.configured_hz / 1e6:.4g} MHz as configured.\n{HELP}")  # fmt: skip
    clock = None
    while clock is None:
        word = _answer(prompt, "measured > ")
        try:
            clock = by_instrument(clocked, pulse, word) if word else _by_protractor(rover, clocked, prompt)
        except (CalibrationAborted, MotionInterrupted):
            raise
        except LrmError as error:
            show(str(error))
    show(result_text(clocked, clock))
    return clock


_MEASURED = re.compile(r"(\d+(?:\.(\d+))?)\s*(us|µs|ms|hz)(?:\s*(?:\+-|\+/-|±)\s*(\d+(?:\.\d+)?))?", re.IGNORECASE)


def by_instrument(servo: ClockedServo, pulse_s: float, text: str) -> Oscillator:
    """From what was measured at the pin while `pulse_s` (s, configured) comes out, as in `HELP`. Raises `LrmError`."""
    match = _MEASURED.fullmatch(text.strip())
    if match is None:
        raise LrmError(f"'{text}': should be like 1389us, 18.52ms +- 0.01 or 54.0Hz")
    value, unit = float(match[1]), match[3].lower()
    error = float(match[4]) if match[4] else 10.0 ** -len(match[2] or "")
    period = COUNTS_PER_PERIOD * servo.count_s
    expected, name, name_unit = {
        "ms": (period * 1e3, "period", "ms"), "hz": (1.0 / period, "frequency", "Hz"),
    }.get(unit, (pulse_s * 1e6, "pulse", "us"))  # fmt: skip
    ratio = value / expected if unit == "hz" else expected / value if value else math.inf
    bounds = sorted(expected * (hz / servo.configured_hz if unit == "hz" else servo.configured_hz / hz)
                    for hz in (SLOWEST_HZ, FASTEST_HZ))  # fmt: skip
    if not bounds[0] <= value <= bounds[1]:
        low, high = bounds
        raise LrmError(f"'{text}': no {name} of this board; should be {low:.4g} to {high:.4g} {name_unit}")
    if not 0 < error <= COARSEST * value:
        raise LrmError(f"'{text}': the uncertainty should be more than 0 and at most {COARSEST:.0%} of the value")
    return Oscillator(ratio * servo.configured_hz, ratio * servo.configured_hz * error / value)


def by_angles(servo: ClockedServo, pulses_s: tuple[float, float], turn: float, error: float) -> Oscillator:
    """From the turn of the shaft (rad) between two pulses (s, configured), with its error (rad). Raises `LrmError`.

    The servo's table is taken to be right within `TABLE`: a servo tells only the product of its gain and the clock.
    """
    hz = np.linspace(SLOWEST_HZ, FASTEST_HZ, 2001)
    first, second = (servo.table.angle_of(pulse * servo.configured_hz / hz) for pulse in pulses_s)
    turns = np.abs(second - first)
    if not np.all(np.diff(turns) < 0):
        raise LrmError("these two angles do not tell the clock; turn the servo further, to both sides")
    if not turns[-1] <= turn <= turns[0]:
        low, high = math.degrees(turns[-1]), math.degrees(turns[0])
        text = f"{low:.0f} to {high:.0f} deg; were the angles read in degrees, from one zero?"
        raise LrmError(f"a turn of {math.degrees(turn):.1f} deg is none of this servo between these pulses: {text}")
    rates, fewer, more = np.interp([turn, turn - error, turn + error], turns[::-1], hz[::-1])
    return Oscillator(float(rates), math.hypot(float(fewer - more) / 2, TABLE * float(rates)))


def result_text(servo: ClockedServo, clock: Oscillator) -> str:
    """Lines that say the oscillator, what it means, and what to do."""
    zero = math.degrees(servo.angle_at(float(servo.table.pulse_of(0.0)), clock.hz))
    off = servo.configured_hz / clock.hz - 1
    lines = [f"oscillator: {clock.hz / 1e6:.3f} +- {clock.uncertainty_hz / 1e6:.3f} MHz, configured "
             f"{servo.configured_hz / 1e6:.4g} MHz: pulses are {abs(off):.1%} too {'long' if off > 0 else 'short'}, "
             f"{servo.name} stands at {zero:+.1f} deg when it is told 0"]  # fmt: skip
    if abs(clock.hz - servo.configured_hz) <= clock.uncertainty_hz:
        return "\n".join([*lines, "That is within the uncertainty: leave oscillator_hz as it is."])
    return "\n".join([
        *lines,
        "Put this line into [link] of lrmd.toml in place of the present one:",
        f"  oscillator_hz = {clock.hz / 1e6:.4f}e6",
        "Then lay the arm down, `lrm disarm`, and restart the daemon. Its stored pose is not valid any more.",
    ])  # fmt: skip


def _switch_on(rover: Rover, servo: ClockedServo, prompt: Prompt, show: Show) -> None:
    """Gives a servo its first pulse, if it has none, where the operator says that it stands, and after a warning."""
    joints, (low, high) = rover.joints(), servo.limits
    if joints.on[joints.names.index(servo.name)]:
        return
    while True:
        word = _answer(prompt, f"{servo.name} has no pulses. Angle where it stands, in deg (q stops) > ")
        try:
            angle = parse_angle(word)
        except LrmError as error:
            show(str(error))
            continue
        if low <= angle <= high:
            break
        show(f"{servo.name}: should be {math.degrees(low):.0f} to {math.degrees(high):.0f} deg")
    far = math.degrees(max(abs(end - angle) for end in servo.reached(angle)))
    warning = f"{servo.name} may jump by up to {far:.0f} deg at full speed, since the clock is not known yet"
    show(f"{servo.name} gets its first pulse now, no other servo does. If the servos' power is on, {warning}.")
    _agreed(prompt, "ENTER: switch it on; q: stop > ")
    rover.arm("given", {servo.name: angle})


def _by_protractor(rover: Rover, servo: ClockedServo, prompt: Prompt) -> Oscillator:
    """Two moves, each asked for by the operator, and the angle that is read off after each."""
    (first, a, angle_first), (second, b, other) = (
        _turned(rover, servo, prompt, which) for which in ("first", "second")
    )
    if abs(b - a) < SMALLEST_TURN:
        far = math.degrees(SMALLEST_TURN)
        raise LrmError(f"the two angles are {math.degrees(abs(b - a)):.1f} deg apart: should be {far:.0f} or more")
    return by_angles(servo, (first, second), abs(b - a), math.hypot(angle_first, other))


def _turned(rover: Rover, servo: ClockedServo, prompt: Prompt, which: str) -> tuple[float, float, float]:
    """Pulse (s, configured), angle that was read off (rad), and its uncertainty (rad)."""
    wanted = parse_angle(_answer(prompt, f"{which} of two angles to turn {servo.name} to, in deg (q stops) > "))
    least, most = servo.reached(wanted)
    if not (servo.limits[0] <= least and most <= servo.limits[1]):
        low, high = (math.degrees(end) for end in servo.limits)
        turn = f"{math.degrees(least):.0f} to {math.degrees(most):.0f} deg"
        raise LrmError(f"an oscillator that is off may turn it to {turn}; its limits are {low:.0f} to {high:.0f} deg")
    rover.move({servo.name: wanted})
    word, _, error = _answer(prompt, "the protractor shows (deg, or 31 +- 0.5) > ").partition("+-")
    uncertainty = parse_angle(error) if error else READING
    if not 0 < uncertainty <= SMALLEST_TURN / 3:
        raise LrmError(f"uncertainty '{error.strip()}': should be more than 0 and at most 10 deg")
    return servo.put_out(_pulse_s(rover, servo.name)), parse_angle(word), uncertainty


def _pulse_s(rover: Rover, servo: str) -> float:
    joints = rover.joints()
    return joints.pulse_us[joints.names.index(servo)] * 1e-6


def _agreed(prompt: Prompt, question: str) -> None:
    while _answer(prompt, question) != "":
        pass


def _answer(prompt: Prompt, question: str) -> str:
    """One word of the operator. Raises `CalibrationAborted` at `q` and where the input ends."""
    try:
        word = prompt(question).strip()
    except EOFError:
        word = "q"
    if word == "q":
        raise CalibrationAborted("stopped; the clock was not measured")
    return word
