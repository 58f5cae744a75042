"""Fair timing: contenders take turns, so that a change of the machine's speed meets them all alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

ROUNDS, ROUND_S = 9, 0.05


@dataclass(frozen=True)
class Timing:
    """Median and fastest time of one call (s)."""

    median: float
    best: float


def race(contenders: Mapping[str, Callable[[], object]]) -> dict[str, Timing]:
    """Times each contender in turn, several rounds of at least `ROUND_S` seconds or one call."""
    calls = {name: _calls_per_round(run) for name, run in contenders.items()}
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(ROUNDS):
        for name, run in contenders.items():
            start = time.perf_counter()
            for _ in range(calls[name]):
                run()
            times[name].append((time.perf_counter() - start) / calls[name])
    return {name: Timing(statistics.median(spent), min(spent)) for name, spent in times.items()}


def _calls_per_round(run: Callable[[], object]) -> int:
    run()
    start = time.perf_counter()
    run()
    return max(1, int(ROUND_S / max(time.perf_counter() - start, 1e-7)))
