"""Histogram of tick lateness, and the percentiles and coarse buckets derived from it."""

from __future__ import annotations

from dataclasses import dataclass

EDGES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 30, 40, 50, 60, 80, 100, 120, 160, 200, 250, 300, 400, 511)
"""Upper edges of the coarse buckets, in fine ones, roughly logarithmic; the last bucket of either kind is open."""


@dataclass(frozen=True)
class Lateness:
    """Tick counts per fine bucket of `width_us`; the last bucket has no upper edge.

    `measured_us`: the largest lateness reported; the counts may be a tick ahead of it.
    """

    counts: tuple[int, ...]
    width_us: float
    measured_us: float

    @property
    def ticks(self) -> int:
        """Total number of ticks."""
        return sum(self.counts)

    @property
    def largest_us(self) -> float:
        """Largest lateness, at least the lower edge of the last non-empty bucket; 0 without ticks."""
        last = max((bucket for bucket, count in enumerate(self.counts) if count), default=0)
        return max(self.measured_us, last * self.width_us)

    def percentile_us(self, share: float) -> float:
        """Upper edge (us) of the fine bucket of quantile `share`; `largest_us` if that is the open one, 0 if empty."""
        ticks, seen = self.ticks, 0
        if not ticks:
            return 0.0
        for bucket, count in enumerate(self.counts[:-1]):
            seen += count
            if count and seen >= share * ticks:
                return (bucket + 1) * self.width_us
        return self.largest_us

    def upper_us(self) -> list[float]:
        """Exclusive upper edges (us) of the coarse buckets but the last."""
        return [edge * self.width_us for edge in EDGES]

    def coarse(self) -> list[int]:
        """Ticks per coarse bucket; the last one is open."""
        return [sum(self.counts[a:b]) for a, b in zip((0, *EDGES), (*EDGES, len(self.counts)), strict=True)]
