"""Input shaping: a command split into impulses that leave no swing at known frequencies (Singer & Seering 1990).

With K = exp(−ζπ/√(1 − ζ²)) and T the period of the damped swing, a zero-vibration shaper (`zv`) is the impulses 1 and
K at 0 and T/2, over their sum. `zvd` and `zvdd` are two and three of them in a row: longer, and less sensitive to an
error of the frequency. Shapers of several modes are convolved. All shares are positive and add up to 1, so a shaped
command never goes faster than the command itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Literal, TypeAlias, get_args

import numpy as np

from lrm_math.motion.modes import Modes

ShaperKind: TypeAlias = Literal["zv", "zvd", "zvdd"]
Impulses: TypeAlias = tuple[tuple[int, int], ...]
"""Delay (ticks) and share of each impulse, the first without delay."""
MOST_MODES = 3
"""Modes that are shaped, the slowest ones."""
QUICKEST_TICKS, DAMPED = 4.0, 0.5
"""Modes of a shorter period (ticks), or with more damping, need no shaper: they fade by themselves."""


def shaper(kind: ShaperKind, modes: Modes, tick: float, whole: int, most: int) -> Impulses:
    """The impulses that leave none of the modes swinging, on ticks (s); empty where none needs any.

    Their shares are integers that add up to `whole`. With more than `most` they lie on the nearest ticks only.
    """
    slow = (modes.damping < DAMPED) & (modes.frequency * tick * QUICKEST_TICKS < 1.0) & (modes.frequency > 0.0)
    chosen = np.flatnonzero(slow)[np.argsort(modes.frequency[slow])][:MOST_MODES]
    parts = [one_mode(kind, float(modes.frequency[k]), float(modes.damping[k])) for k in chosen]
    if not parts:
        return ()
    each = [(sum(t for t, _ in row), float(np.prod([share for _, share in row]))) for row in product(*parts)]
    split = on_ticks(each, tick, whole, True)
    return split if len(split) <= most else on_ticks(each, tick, whole, False)


def one_mode(kind: ShaperKind, frequency: float, damping: float) -> list[tuple[float, float]]:
    """Time (s) and share of each impulse for a mode of a damped frequency (Hz) and damping ratio."""
    half = 0.5 / frequency
    K = np.exp(-damping * np.pi / np.sqrt(1.0 - damping**2))
    rows = np.array([1.0])
    for _ in range(1 + get_args(ShaperKind).index(kind)):
        rows = np.convolve(rows, np.array([1.0, K]) / (1.0 + K))
    return [(k * half, float(share)) for k, share in enumerate(rows)]


def on_ticks(impulses: Sequence[tuple[float, float]], tick: float, whole: int, split: bool) -> Impulses:
    """Impulses (s, share) on a grid of ticks (s); `split`: each between the two ticks beside it, else on the nearer."""
    by_tick: dict[int, float] = {}
    for seconds, share in impulses:
        at = seconds / tick
        before = int(at) if split else round(at)
        part = at - before if split else 0.0
        by_tick[before] = by_tick.get(before, 0.0) + (1.0 - part) * share
        by_tick[before + 1] = by_tick.get(before + 1, 0.0) + part * share
    delays = sorted(delay for delay, share in by_tick.items() if share * whole >= 1.0)
    wanted = np.array([by_tick[delay] for delay in delays])
    shares = np.floor(wanted / wanted.sum() * whole).astype(int)
    shares[int(np.argmax(shares))] += whole - int(shares.sum())
    return tuple(zip(delays, shares.tolist(), strict=True))
