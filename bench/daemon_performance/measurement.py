"""Common parts of the daemon's measurements: a figure, a harness of real processes, and times on one clock."""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.support.daemon.daemon_harness import DaemonHarness, connected
from tests.support.daemon.daemon_process import BoardProcess, DaemonSetup, wait_for
from tests.support.daemon.pulse_invariants import FrameLogEntry, PulseInvariants, read_frames

MS = 1_000_000
FAR, NEAR = {"joint1": 1.5}, {"joint1": -1.5}


@dataclass(frozen=True)
class PerformanceFigure:
    """A measured quantity: its values, and the most that they should be (None: for comparison only)."""

    what: str
    values: tuple[float, ...]
    unit: str
    goal: float | None = None


@contextmanager
def setup_with_board(changes: Mapping[str, str] | None = None) -> Iterator[tuple[DaemonSetup, BoardProcess]]:
    """A folder of its own, gone afterwards, and a board in it. `changes`: as those of `DaemonSetup.make`."""
    with TemporaryDirectory() as folder:
        setup = DaemonSetup.make(Path(folder), changes)
        with BoardProcess(setup) as board:
            yield setup, board


def step(found: PulseInvariants) -> PerformanceFigure:
    """The largest step in a frame log."""
    what = f"- largest step in {found.frames} frames"
    return PerformanceFigure(what, (found.largest_step / 1e3,), "us", found.allowed / 1e3)


class PerformanceHarness(DaemonHarness):
    """A harness whose figures are read from the frame log."""

    def frames(self) -> list[FrameLogEntry]:
        """The accepted ARM frames so far, on the monotonic clock (ns)."""
        entries = read_frames(self.setup.log)
        return [FrameLogEntry(e.t + self.board_started, e.event, e.counts) for e in entries if e.event == "arm"]

    def step(self) -> PerformanceFigure:
        """The largest step in the whole log. Raises `AssertionError` if any invariant was broken."""
        return step(self.check_invariants())


@contextmanager
def running_harness(changes: Mapping[str, str] | None = None) -> Iterator[PerformanceHarness]:
    """A harness, and all of it ended afterwards. `changes`: as those of `DaemonSetup.make`."""
    with setup_with_board(changes) as (setup, board), connected(setup) as (daemon, rover):
        yield PerformanceHarness(setup, board, daemon, rover)


def time_when(condition: Callable[[], bool]) -> int:
    """Monotonic ns at which something became true, to a few tenths of a ms."""
    wait_for(condition, "the condition holds", pause=0.0002)
    return time.monotonic_ns()


def delays(causes: Sequence[int], effects: Sequence[int]) -> tuple[float, ...]:
    """ms from every cause to the first effect after it (ns, both sorted)."""
    return tuple((effects[bisect_left(effects, at)] - at) / MS for at in causes)
