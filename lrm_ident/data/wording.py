"""Figures and lists in words; figures in mm have two significant digits at least: micrometres do not print as 0.00."""

from __future__ import annotations

import math
from collections.abc import Sequence

LEAST, MOST = 2, 6  # decimals


def decimals(*values: float) -> int:
    """Decimals that show two significant digits of the smallest of some values (two at least); zero needs none."""
    sizes = [abs(value) for value in values if value and math.isfinite(value)]
    return min(max(LEAST, 1 - math.floor(math.log10(min(sizes)))), MOST) if sizes else LEAST


def in_mm(value: float) -> str:
    """A length (m) in mm, without the unit."""
    mm = value * 1e3
    return f"{mm:.{decimals(mm)}f}"


def in_minutes(seconds: float) -> str:
    """A rough time in words."""
    if seconds < 90.0:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def enumerate_words(names: Sequence[str], most: int) -> str:
    """The first names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
