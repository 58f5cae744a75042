"""The result of a fuzz run: what came out how often, and every violation."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field


@dataclass
class FuzzResult:
    """Counts by outcome, and one line for every input that broke a rule."""

    counts: Counter[str] = field(default_factory=Counter)
    violations: list[str] = field(default_factory=list)
