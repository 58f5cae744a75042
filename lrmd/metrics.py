"""Percentiles of a histogram of counts."""

from __future__ import annotations

from collections.abc import Sequence


def percentile(counts: Sequence[int], share: float, width: float) -> float:
    """Upper edge of the bucket below which `share` of the counts lie, in units of `width`; 0 if there are none."""
    total = sum(counts)
    if not total:
        return 0.0
    seen, wanted = 0, share * total
    for bucket, count in enumerate(counts):
        seen += count
        if seen >= wanted:
            return (bucket + 1) * width
    return len(counts) * width
