"""Level-1 servo calibration with a protractor: table of pulse against angle (Conenna 2024, section 3.4; Table 3.1).

For each angle the operator adjusts the pulse until the pointer of a printed protractor is there, or types the angle
that it shows. Two or more angles; the table is interpolated linearly.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from lrm_math.arm.arm_file import ARM_SCHEMA, load_arm, read_arm, shipped_arms
from lrm_math.arm.servo_table import ServoTable
from lrm_math.atomic_file import write_atomically
from lrm_math.errors import FileError, LrmError
from lrm_math.toml_file import schema_of
from lrmd.cli.parsing import parse_angle
from lrmd.client import Rover

HELP = """\
  +5, -2.5         change the pulse by so many us
  ENTER            the pointer stands at the wanted angle: take it
  98.5, -98.5deg   the pointer shows this angle instead: take that (below zero with its unit)
  q                stop; nothing is written"""


class CalibrationAborted(LrmError):
    """The operator aborted the calibration."""


def calibrate_servo(
    rover: Rover,
    servo: str,
    arm: str,
    output: Path,
    angles: Sequence[float],
    prompt: Callable[[str], str] = input,
    show: Callable[[str], None] = print,
) -> None:
    """Guides the operator through one servo and writes `arm` with its new table to `output`. Raises `LrmError`."""
    _check(rover, servo, angles)
    load_arm(arm)
    text = shipped_arms().get(arm, Path(arm)).read_text(encoding="utf-8")
    _table_lines(text.splitlines(), servo)
    if not output.parent.is_dir():
        raise FileError(output, "", "cannot be written (no such folder)")
    if output.exists() and schema_of(output) != ARM_SCHEMA:
        raise FileError(output, "", "exists and is no arm file", "name another file")
    show(f"{servo}: put the protractor on. The arm will turn this servo to {len(angles)} places.\n{HELP}")
    pairs = sorted(_measure(rover, servo, angle, prompt, show) for angle in sorted(angles))
    table = ServoTable(tuple(a for a, _ in pairs), tuple(p * 1e-6 for _, p in pairs))
    write_atomically(output, replace_table(text, servo, table).encode(), check=read_arm)
    show(f"{output}: {servo} now has {len(pairs)} measured angles. Name this file as `arm` in lrmd.toml.")


def _check(rover: Rover, servo: str, angles: Sequence[float]) -> None:
    info, joints = rover.info(), rover.joints()
    if servo not in info.names:
        raise LrmError(f"unknown servo '{servo}'; valid: {', '.join(info.names)}")
    if len(set(angles)) < 2:
        raise LrmError("a table needs two or more different angles")
    if not joints.on[info.names.index(servo)]:
        raise LrmError(f"{servo} has no pulses; arm it first (lrm arm --at {servo} ANGLE)")


def _measure(
    rover: Rover, servo: str, wanted: float, prompt: Callable[[str], str], show: Callable[[str], None]
) -> tuple[float, float]:
    """One pair of measured angle (rad) and pulse (us)."""
    rover.move({servo: wanted})
    while True:
        pulse = _pulse(rover, servo)
        word = prompt(f"{servo} {math.degrees(wanted):g} deg, {pulse:.1f} us > ").strip()
        if word == "":
            return wanted, pulse
        if word == "q":
            raise CalibrationAborted("stopped; nothing was written")
        try:
            if word[0] in "+-" and not word.endswith(("deg", "rad", "°")):
                _nudge(rover, servo, float(word))
            else:
                return parse_angle(word), pulse
        except (ValueError, LrmError) as error:
            show(f"{error}\n{HELP}")


def _pulse(rover: Rover, servo: str) -> float:
    joints = rover.joints()
    return joints.pulse_us[joints.names.index(servo)]


def _nudge(rover: Rover, servo: str, us: float) -> None:
    info, joints = rover.info(), rover.joints()
    i = info.names.index(servo)
    table = ServoTable(tuple(info.tables_rad[i]), tuple(p * 1e-6 for p in info.tables_us[i]))
    rover.move({servo: float(table.angle_of((joints.pulse_us[i] + us) * 1e-6))})


_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\]]+?)\s*\]\]?\s*(?:#.*)?$")


def replace_table(text: str, servo: str, table: ServoTable) -> str:
    """The text of an arm file with one servo's table replaced and everything else kept. Raises `LrmError`."""
    angles = ", ".join(repr(round(math.degrees(a), 4)) for a in table.angle)
    pulses = ", ".join(repr(round(p * 1e6, 3)) for p in table.pulse)
    lines = text.splitlines()
    first, last = _table_lines(lines, servo)
    if servo.startswith("joint"):
        keys, new = "servo", [f"servo = {{ angle_deg = [{angles}], pulse_us = [{pulses}] }}"]
    else:
        keys, new = "angle_deg|pulse_us", [f"angle_deg = [{angles}]", f"pulse_us = [{pulses}]"]
    kept = [line for line in lines[first:last] if not re.match(rf"\s*({keys})\s*=", line)]
    return "\n".join([*lines[:first], *kept, *new, *lines[last:]]) + "\n"


def _table_lines(lines: Sequence[str], servo: str) -> tuple[int, int]:
    """Half-open line range of a servo's table, from below its heading to the next heading or the comment above it."""
    headings = [(i, m[2].replace(" ", "")) for i, line in enumerate(lines) if (m := _HEADER.match(line))]
    joints = [i for i, name in headings if name == "joint"]
    number = servo.removeprefix("joint")
    if servo.startswith("joint") and number.isdecimal() and 1 <= int(number) <= len(joints):
        start = joints[int(number) - 1]
    else:
        named = [i for i, name in headings if name == f"auxiliary_servo.{servo}"]
        if not named:
            raise LrmError(f"the arm file has no table for {servo}; write one under [auxiliary_servo.{servo}] first")
        start = named[0]
    end = next((i for i, _ in headings if i > start), len(lines))
    while end < len(lines) and end > start + 1 and (not lines[end - 1].strip() or lines[end - 1].lstrip()[0] == "#"):
        end -= 1
    return start + 1, end
