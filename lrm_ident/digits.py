"""Figures in mm with at least two significant digits, so that a stiff arm's micrometres do not print as 0.00."""

from __future__ import annotations

import math

LEAST, MOST = 2, 6  # decimals


def decimals(*values: float) -> int:
    """Decimals that show two significant digits of the smallest of some values (two at least); zero needs none."""
    sizes = [abs(value) for value in values if value and math.isfinite(value)]
    return min(max(LEAST, 1 - math.floor(math.log10(min(sizes)))), MOST) if sizes else LEAST


def in_mm(value: float) -> str:
    """A length (m) in mm, without the unit."""
    mm = value * 1e3
    return f"{mm:.{decimals(mm)}f}"
