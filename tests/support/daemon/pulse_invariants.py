"""Invariants of a simulated board's frame log: no jump, nothing switched on without a request or outside its limits."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from lrmd.config import Config


@dataclass(frozen=True)
class FrameLogEntry:
    """One line of a frame log: `t` (ns of the board's clock), `event`, counts by channel of an `arm` (0 = off)."""

    t: int
    event: str
    counts: dict[int, int]

    @property
    def pulsing(self) -> bool:
        """Whether it is a frame that keeps any channel on."""
        return any(self.counts.values())


def read_frames(path: Path) -> list[FrameLogEntry]:
    """A frame log, without a last line that is still being written."""
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1].splitlines()
    return [
        FrameLogEntry(int(row["t_ns"]), row["event"], {c: int(row[f"ch{c}"]) for c in range(16) if row[f"ch{c}"]})
        for row in csv.DictReader(whole)
    ]


@dataclass(frozen=True)
class PulseInvariants:
    """Figures of a frame log. `largest_step`: of a channel that stays on, ns of pulse; `allowed` ns in one frame, the
    rounding to counts included. `switched_on`: (board ns, channel) of every switching on. `outside`: frames with a
    pulse outside its servo's limits. `frames`: how many were accepted.
    """

    frames: int
    largest_step: float
    allowed: float
    switched_on: tuple[tuple[int, int], ...]
    outside: int

    def check(self, armed_at: list[int], within: int = 2_000_000_000) -> None:
        """Asserts the invariants, where switching on was requested at `armed_at` (board ns)."""
        assert self.largest_step <= self.allowed, f"a jump of {self.largest_step:.0f} ns in one frame"
        assert self.outside == 0, f"{self.outside} frames outside the limits"
        for t, channel in self.switched_on:
            assert any(0 <= t - at <= within for at in armed_at), f"channel {channel} went on at {t} ns, unrequested"


def pulse_invariants(config: Config, lines: list[FrameLogEntry]) -> PulseInvariants:
    """Looks at every frame of a log."""
    count_ns = config.clock.count_s * 1e9
    limits = {s.channel: (s.lowest - count_ns, s.highest + count_ns) for s in config.servos}
    on: dict[int, int] = {}
    largest, outside, switched = 0, 0, []
    for line in lines:
        if line.event in ("silence", "power"):
            on.clear()
        if line.event != "arm":
            continue
        for channel, count in line.counts.items():
            before = on.pop(channel, 0)
            if not count:
                continue
            on[channel] = count
            outside += not limits[channel][0] <= count * count_ns <= limits[channel][1]
            if before:
                largest = max(largest, abs(count - before))
            else:
                switched.append((line.t, channel))
    frames = sum(line.event == "arm" for line in lines)
    return PulseInvariants(frames, largest * count_ns, config.step + count_ns, tuple(switched), outside)
