"""Integer interpolation of a move: every pulse after each tick.

A tick changes a pulse by at most one step (1 us in Conenna 2024, section 5.4). A shaped move is the sum of delayed
shares of the same move (`lrm_math.motion.shaping`), or stands still for some ticks (`lrm_math.motion.waits`): it takes
the same way, and no tick of it is longer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeAlias

Impulses: TypeAlias = tuple[tuple[int, int], ...]
"""Delay (ticks) and share (of `SHARES`, their sum) of each part of a shaped move; empty: it is not shaped."""
SHARES = 1 << 15
MOST_DELAY = 1000
Waits: TypeAlias = tuple[tuple[int, int], ...]
"""Ticks of the move that remain where it stands still, falling, and the ticks for which it does."""


def valid_impulses(impulses: Impulses) -> bool:
    """Whether a move may be shaped so: positive shares that add up to the whole, and no long delay."""
    return not impulses or (
        sum(share for _, share in impulses) == SHARES
        and all(0 <= delay <= MOST_DELAY and share > 0 for delay, share in impulses)
    )


def valid_waits(waits: Waits) -> bool:
    """Whether a move may wait so: ever nearer to its end, not at its end, and not for long in all."""
    left = [remaining for remaining, _ in waits]
    ticks = [ticks for _, ticks in waits]
    return left == sorted({*left}, reverse=True) and all(k > 0 for k in (*left, *ticks)) and sum(ticks) <= MOST_DELAY


class Pace(IntEnum):
    """Synchronisation of a move: all servos end together, or each runs at its own full rate."""

    TOGETHER = 0
    EACH = 1


@dataclass(frozen=True, slots=True)
class Move:
    """A staircase per servo: from `start` over `distance` (ns of pulse) in `ticks` ticks, shaped by `impulses` and
    with `waits`."""

    start: tuple[int, ...]
    distance: tuple[int, ...]
    ticks: tuple[int, ...]
    impulses: Impulses = ()
    waits: Waits = ()

    @property
    def length(self) -> int:
        """Ticks until the last servo arrives; 0 where none moves."""
        return self._without_waits + sum(ticks for _, ticks in self.waits) if self._without_waits else 0

    @property
    def _without_waits(self) -> int:
        longest = max(self.ticks, default=0)
        return longest + max((delay for delay, _ in self.impulses), default=0) if longest else 0

    def at(self, k: int) -> tuple[int, ...]:
        """Pulses (ns) after `k` ticks. Consecutive values differ by at most the stride of the move."""
        for remaining, ticks in self.waits:
            if k <= (begin := max(self._without_waits - remaining, 0)):
                break
            k = max(begin, k - ticks)
        if self.impulses:
            done = {n: sum(share * min(max(k - delay, 0), n) for delay, share in self.impulses) for n in {*self.ticks}}
            return tuple(
                s + (d * done[n] // (SHARES * n) if n else d)
                for s, d, n in zip(self.start, self.distance, self.ticks, strict=True)
            )
        return tuple(
            s + (d * k // n if k < n else d) for s, d, n in zip(self.start, self.distance, self.ticks, strict=True)
        )


def move(
    start: Sequence[int], target: Sequence[int], stride: Sequence[int], pace: Pace, impulses: Impulses = (),
    waits: Waits = (),
) -> Move:  # fmt: skip
    """The move from `start` to `target` (ns per servo) with at most `stride` (ns, > 0) per tick, shaped by impulses
    and with waits."""
    distance = tuple(t - s for s, t in zip(start, target, strict=True))
    ticks = tuple(-(-abs(d) // s) for d, s in zip(distance, stride, strict=True))
    if pace is Pace.TOGETHER:
        longest = max(ticks, default=0)
        ticks = tuple(longest if n else 0 for n in ticks)
    return Move(tuple(start), distance, ticks, impulses, waits)


@dataclass(frozen=True, slots=True)
class Way:
    """Moves one after the other: each with the tick at which it is left, and `done`, the ticks taken of the first."""

    parts: tuple[tuple[Move, int], ...] = ()
    done: int = 0

    @property
    def remaining(self) -> int:
        """Ticks until its end."""
        return sum(ticks for _, ticks in self.parts) - self.done

    def at(self, remaining: int) -> tuple[int, ...]:
        """Pulses (ns) where so many ticks remain, 0 to `remaining`."""
        left = remaining
        for part, ticks in reversed(self.parts):
            if left <= ticks:
                return part.at(ticks - left)
            left -= ticks
        raise ValueError(f"{remaining} ticks; the way has {self.remaining}")

    def branch(self, remaining: int, onward: Move) -> Way:
        """The way that leaves this one where so many ticks remain, and goes on along a move from there."""
        left, parts = remaining, list(self.parts)
        while parts and left >= parts[-1][1] and len(parts) > 1:
            left -= parts.pop()[1]
        if parts:
            parts[-1] = parts[-1][0], parts[-1][1] - left
        way = Way((*parts, (onward, onward.length)), self.done)
        return way.advanced_to(way.remaining)

    def step(self) -> Way:
        """The way after one more tick."""
        return self.advanced_to(self.remaining - 1)

    def advanced_to(self, remaining: int) -> Way:
        """The way where so many ticks remain, without the moves that are over."""
        parts, done = self.parts, sum(ticks for _, ticks in self.parts) - remaining
        while parts and done >= parts[0][1]:
            done, parts = done - parts[0][1], parts[1:]
        return Way(parts, done if parts else 0)
