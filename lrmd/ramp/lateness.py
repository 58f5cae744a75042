"""How late ticks were: one histogram, from which everything that is told of lateness follows."""

from __future__ import annotations

from dataclasses import dataclass

EDGES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 30, 40, 50, 60, 80, 100, 120, 160, 200, 250, 300, 400, 511)
"""Upper edges of the coarse buckets in fine ones, roughly logarithmic; the 512th fine bucket is open, as is theirs."""


@dataclass(frozen=True)
class Lateness:
    """`counts`: ticks by fine bucket, each `width_us` wide; the last one has no upper edge.

    `measured_us`: the largest lateness that was told; the counts may be a tick ahead of it.
    """

    counts: tuple[int, ...]
    width_us: float
    measured_us: float

    @property
    def ticks(self) -> int:
        """All of them."""
        return sum(self.counts)

    @property
    def largest_us(self) -> float:
        """The largest lateness, at least the lower edge of the last bucket that has a tick; 0 if there were none."""
        last = max((bucket for bucket, count in enumerate(self.counts) if count), default=0)
        return max(self.measured_us, last * self.width_us)

    def percentile_us(self, share: float) -> float:
        """Upper edge (us) of the fine bucket that holds this share of the ticks; the largest if that is the open one.

        0 if there were no ticks.
        """
        ticks, seen = self.ticks, 0
        if not ticks:
            return 0.0
        for bucket, count in enumerate(self.counts[:-1]):
            seen += count
            if count and seen >= share * ticks:
                return (bucket + 1) * self.width_us
        return self.largest_us

    def upper_us(self) -> list[float]:
        """Upper edges (us) of the coarse buckets: a tick in one was less late than that. One less than `coarse`."""
        return [edge * self.width_us for edge in EDGES]

    def coarse(self) -> list[int]:
        """Ticks by coarse bucket; the last one has those that were later than every edge."""
        return [sum(self.counts[a:b]) for a, b in zip((0, *EDGES), (*EDGES, len(self.counts)), strict=True)]
