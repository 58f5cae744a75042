"""Times at which the ramp switched all outputs off: `python -m tests.support.daemon.pulse_ends DESCRIPTOR`.

Read from the daemon's shared memory, so without the way of the bytes through a pseudo-terminal, which a worker thread
of the kernel carries at ordinary priority: the frame has been handed to the serial port by then.
"""

from __future__ import annotations

import os
import sys
import time
from bisect import bisect_left
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from lrmd.ramp.shared_memory import SharedRecords
from tests.support.module_process import ModuleProcess

PERIOD_S = 0.0005


def watch(descriptor: str) -> None:
    """Prints the time (monotonic ns) of every end of the pulses, for ever."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(2))
    shared, pulsing = SharedRecords(os.open(descriptor, os.O_RDWR)), False
    while True:
        report = shared.read_report()
        now = report is not None and bool(report.outputs)
        if pulsing and not now:
            print(time.monotonic_ns(), flush=True)
        pulsing = now
        time.sleep(PERIOD_S)


def shared_memory_of(pid: int) -> str:
    """Path of the descriptor of a daemon's shared memory."""
    folder = Path(f"/proc/{pid}/fd")
    return str(next(path for path in folder.iterdir() if "memfd:lrmd" in os.readlink(path)))


def delays_until(ends: Sequence[int], starts: Sequence[int]) -> tuple[float, ...]:
    """ms from each start to the next end (monotonic ns, ascending), of those that have one."""
    after = [ends[k:][:1] for k in (bisect_left(ends, start) for start in starts)]
    return tuple((end[0] - start) / 1e6 for start, end in zip(starts, after, strict=True) if end)


class PulseEnds(ModuleProcess):
    """That watch of a daemon (`pid`) as a process of its own."""

    def __init__(self, pid: int) -> None:
        super().__init__("tests.support.daemon.pulse_ends", shared_memory_of(pid))

    def stop(self) -> list[int]:
        """Ends the watch; the times (monotonic ns) that it saw."""
        return [int(line) for line in self.end().splitlines()]


if __name__ == "__main__":
    watch(*sys.argv[1:])
