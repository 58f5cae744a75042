"""The stepping rule: where every pulse stands after each tick of a move, and when the next tick is due. Pure integers.

A tick changes a pulse by at most one step (1 us in the thesis, section 5.4). A late tick is skipped, never caught up:
the staircase only gets longer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum


class Pace(IntEnum):
    """How the servos of one move keep time: all end together, or each runs at its own full rate."""

    TOGETHER = 0
    EACH = 1


@dataclass(frozen=True, slots=True)
class Move:
    """A staircase for every servo: from `start` over `distance` (ns of pulse) in `ticks` ticks."""

    start: tuple[int, ...]
    distance: tuple[int, ...]
    ticks: tuple[int, ...]

    @property
    def length(self) -> int:
        """Ticks until the last servo is there."""
        return max(self.ticks, default=0)

    def at(self, k: int) -> tuple[int, ...]:
        """Pulses (ns) after `k` ticks. Consecutive values differ by at most the stride that the move was made with."""
        return tuple(
            s + (d * k // n if k < n else d) for s, d, n in zip(self.start, self.distance, self.ticks, strict=True)
        )


def move(start: Sequence[int], target: Sequence[int], stride: Sequence[int], pace: Pace) -> Move:
    """A move from pulse to pulse (ns) with at most `stride` (ns, > 0) per tick and servo."""
    distance = tuple(t - s for s, t in zip(start, target, strict=True))
    ticks = tuple(-(-abs(d) // s) for d, s in zip(distance, stride, strict=True))
    if pace is Pace.TOGETHER:
        longest = max(ticks, default=0)
        ticks = tuple(longest if n else 0 for n in ticks)
    return Move(tuple(start), distance, ticks)


def next_due(now: int, due: int, period: int) -> tuple[int, int]:
    """When the tick after the one that was due at `due` is due, and how many were skipped (ns, ns, ns).

    Deadlines stay on one grid. What is already past is skipped. If the clock went back by more than a period, the grid
    begins anew from now.
    """
    if now < due - period:
        return now + period, 0
    skipped = max(0, (now - due) // period)
    return due + (skipped + 1) * period, skipped
