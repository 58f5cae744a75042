"""Angles as people type them: `30`, `30deg`, `0.5rad`."""

from __future__ import annotations

import math
import re

from lrm_math.errors import LrmError

_FORM = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*(deg|°|rad)?\s*", re.IGNORECASE)


def angle_of(text: str) -> float:
    """Radians from a number with `deg`, `rad` or nothing (degrees). Raises `LrmError`."""
    match = _FORM.fullmatch(text)
    value = math.nan if match is None else float(match[1])
    if match is None or not math.isfinite(value):
        raise LrmError(f"angle '{text}': should be like 30deg, 30 (degrees) or 0.5rad")
    return value if (match[2] or "").lower() == "rad" else math.radians(value)


def angles_of(text: str) -> list[float]:
    """Radians from several angles with commas between them. Raises `LrmError`."""
    return [angle_of(word) for word in text.split(",")]
