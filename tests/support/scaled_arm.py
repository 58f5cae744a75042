"""Arm files in another unit."""

from __future__ import annotations

import re

NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?")


def scaled_arm(text: str, key: str, factor: float) -> str:
    """An arm file with the numbers of some keys (a regular expression) multiplied."""

    def line(found: re.Match[str]) -> str:
        return found[1] + NUMBER.sub(lambda number: f"{float(number[0]) * factor:.8f}", found[2])

    return re.sub(rf"^(\s*(?:{key})\s*=\s*)([^#\n]*)", line, text, flags=re.MULTILINE)
