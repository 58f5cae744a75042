"""Text of a CSV file of columns."""

from __future__ import annotations

import math
from collections.abc import Iterable

from lrm_math.arrays import Array


def csv_text(columns: Iterable[tuple[str, Array, int]]) -> str:
    """CSV text of (name, values (N,), decimals)."""
    named = list(columns)
    head = ",".join(name for name, _, _ in named)
    lines = (
        ",".join(
            "" if math.isnan(value) else f"{value:.{decimals}f}"
            for value, (_, _, decimals) in zip(row, named, strict=True)
        )
        for row in zip(*(values for _, values, _ in named), strict=True)
    )
    return "\n".join([head, *lines]) + "\n"
