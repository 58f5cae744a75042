"""Numbers that a person typed, with commas between them."""

from __future__ import annotations

import math

from lrm_math.errors import LrmError


def parse_numbers(option: str, text: str, example: str, count: int | None = None) -> list[float]:
    """Finite numbers of an option, `count` of them if that is given. `example`: what would be right.

    Raises `LrmError`.
    """
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or not all(map(math.isfinite, numbers)) or len(numbers) != (count or len(numbers)):
        raise LrmError(f"{option} {text}: should be {example}")
    return numbers
