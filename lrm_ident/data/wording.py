"""Figures and lists in words; figures in mm have two significant digits at least: micrometres do not print as 0.00."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lrm_ident.data.error_stats import ErrorStats
from lrm_math.arm.arm import Arm

LEAST, MOST = 2, 6  # decimals
UNSEEN = "at poses not in the fit"
"""What *held out* says of an error, where it stands first."""
SMALLEST_P = 1e-15
SENSELESS = 1e5
"""Standard error, in units for a person (deg, mm, rad/Nm), beyond which nothing at all is known."""


def decimals(*values: float) -> int:
    """Decimals that show two significant digits of the smallest of some values (two at least); zero needs none."""
    sizes = [abs(value) for value in values if value and math.isfinite(value)]
    return min(max(LEAST, 1 - math.floor(math.log10(min(sizes)))), MOST) if sizes else LEAST


def in_mm(value: float) -> str:
    """A length (m) in mm, without the unit."""
    mm = value * 1e3
    return f"{mm:.{decimals(mm)}f}"


def between_words(error: ErrorStats) -> str:
    """The 95 % interval of an RMS error in mm, such as `0.49 to 0.60`; empty where it is not known."""
    return "" if error.rms_between is None else " to ".join(map(in_mm, error.rms_between))


def with_error(value: float, error: float) -> tuple[str, str]:
    """A value and its standard error, two significant digits of the error; "unknown" where that is beyond all sense."""
    if not math.isfinite(error) or error <= 0.0:
        return f"{value:.4g}", "0" if error == 0.0 else "unknown"
    if error >= SENSELESS:
        return f"{value:.3g}", "unknown"
    places = max(0, 1 - math.floor(math.log10(float(f"{error:.1e}"))))
    return f"{value:z.{places}f}", f"{error:.{places}f}"


def in_percent(share: float) -> str:
    """A share in percent, without the sign: whole ones, and two significant digits below one."""
    return f"{100.0 * share:.0f}" if abs(share) >= 0.01 or share == 0.0 else f"{100.0 * share:.2g}"


def p_words(p_value: float) -> str:
    """`= 0.003`, one significant digit; `< 1e-15` where doubles say no more."""
    return f"= {p_value:.1g}" if p_value >= SMALLEST_P else f"< {SMALLEST_P:.0g}"


def quantity(value: float, error: float) -> str:
    """`2.667 ± 0.093`."""
    return " ± ".join(with_error(value, error))


def both_in_mm(before: float, after: float) -> tuple[str, str]:
    """Two lengths (m) in mm, without the unit, with two significant digits of what lies between them."""
    low, high = sorted((before * 1e3, after * 1e3))
    places = decimals(low, high, high - low)
    return f"{before * 1e3:.{places}f}", f"{after * 1e3:.{places}f}"


def fall(before: float, after: float) -> str:
    """`from 0.1135 to 0.1128`: lengths (m) in mm."""
    return "from {} to {}".format(*both_in_mm(before, after))


def arrow(before: float, after: float) -> str:
    """`0.1135 → 0.1128`: lengths (m) in mm."""
    return " → ".join(both_in_mm(before, after))


def change_words(before: float, after: float) -> str:
    """`fell from 9.40 to 1.76 mm (81 % less)`, or `rose … more`: an error (m) after a step, beside that before it.

    `stayed at 4.96 mm` of a change by less than one in two thousand, which no digit of a table shows.
    """
    if abs(after - before) < 5e-4 * before:
        return f"stayed at {in_mm(after)} mm"
    verb, what = ("fell", "less") if after <= before else ("rose", "more")
    return f"{verb} {fall(before, after)} mm ({in_percent(abs(1.0 - after / before))} % {what})"


def poses_words(numbers: Sequence[int]) -> str:
    """`pose 7`, or `poses 7, 12`."""
    return f"pose{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"


def poses_count(count: int) -> str:
    """`1 pose`, or `12 poses`."""
    return f"{count} pose{'' if count == 1 else 's'}"


def in_minutes(seconds: float) -> str:
    """A rough time in words."""
    if seconds < 90.0:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def enumerate_words(names: Sequence[str], most: int) -> str:
    """The first names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def joint_labels(arm: Arm) -> tuple[str, ...]:
    """Names of an arm's joints as its own description has them, joint1, joint2 … where it has none."""
    return tuple(joint.name or default for joint, default in zip(arm.joints, arm.joint_names, strict=True))


def named_joints(arm: Arm) -> str:
    """The joints' own names after their numbers, to go on a sentence; empty where the arm's file has none."""
    named = [f"{number} {joint.name}" for number, joint in enumerate(arm.joints, start=1) if joint.name]
    return f"; joint {', '.join(named)}" if named else ""
