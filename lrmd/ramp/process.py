"""The real-time process that owns the serial port: a periodic loop with absolute deadlines, and its clock.

A late tick is skipped, never caught up: the staircase of pulses only gets longer.

No zenoh, logging or files here: they would delay ticks of the same interpreter by milliseconds. No numpy and no
configuration either: a ramp that died is back before the board falls silent, also on a slow and busy computer.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import select
import signal
import time
from dataclasses import dataclass

from lrmd.link.serial_port import SerialPort
from lrmd.ramp.board_link import BoardSettings
from lrmd.ramp.core import RampCore
from lrmd.ramp.parent import SharedFd, die_with_parent
from lrmd.ramp.shared_memory import BUCKET_NS, BUCKETS, LinkState, RampReport, SharedRecords

MCL_CURRENT, MCL_FUTURE = 1, 2
DUTY_SHARE = 0.01
"""Weight of the newest tick in the exponential moving average of the duty."""
STANDBY_TICKS = 6
"""Periods between two ticks while the ramp stands by; an emergency stop wakes it before."""
REOPEN_EVERY = 3
"""Ticks between two attempts to reopen a lost port."""


@dataclass(frozen=True)
class MonotonicClock:
    """CLOCK_MONOTONIC since `start` (ns), scaled by `speed`, which differs from 1 with a simulated board only."""

    speed: float = 1.0
    start: int = 0

    def now(self) -> int:
        """Current time, ns."""
        passed = time.monotonic_ns() - self.start
        return int(passed * self.speed) if self.speed != 1.0 else passed

    def seconds_to(self, due: int) -> float:
        """Real time (s) until `due` (ns); 0 if that is over."""
        return max(0.0, (due - self.now()) / self.speed * 1e-9)

    def sleep_until(self, due: int) -> None:
        """Sleeps until `due` (ns). Python sleeps to an absolute time of the same clock, so errors do not accumulate."""
        time.sleep(self.seconds_to(due))

    def wait_for(self, descriptor: int, due: int) -> None:
        """Sleeps until `due` (ns), or until there is something to read from the descriptor."""
        select.select([descriptor], [], [], self.seconds_to(due))


def next_due(now: int, due: int, period: int) -> tuple[int, int]:
    """Next deadline (ns) after `due` on the grid of `period`, and the number of deadlines already missed.

    If the clock went back by more than a period, the grid restarts at `now`.
    """
    if now < due - period:
        return now + period, 0
    skipped = max(0, (now - due) // period)
    return due + (skipped + 1) * period, skipped


@dataclass(frozen=True)
class RampSetup:
    """Start arguments of the ramp process. `tick`: period, ns; `memory`, `estop`: shared memory and eventfd."""

    board: BoardSettings
    port: str
    baud: int
    tick: int
    priority: int
    speed: float
    memory: SharedFd
    estop: SharedFd


def run(setup: RampSetup) -> None:
    """Process entry point: ticks until SIGTERM or the end of the parent."""
    die_with_parent(signal.SIGTERM)
    realtime = request_realtime(setup.priority)
    shared = SharedRecords(setup.memory.number)
    earlier = last_report(shared)
    core = RampCore(setup.board, earlier)
    gc.collect()
    gc.freeze()
    gc.disable()
    with contextlib.suppress(KeyboardInterrupt):
        _loop(setup, shared, core, earlier, realtime)


def last_report(shared: SharedRecords) -> RampReport:
    """The last report of the ramp before, if there was one.

    One that was killed while it wrote left no report that can be read. The newest order says how many faults the API
    process knows of: that it is over is to be one more.
    """
    report, order = shared.read_report(), shared.read_order()
    if report is None and order is not None:
        return RampReport(order=order.number, fault_count=order.fault_count, starts=min(order.fault_count, 1))
    return report or RampReport()


def _loop(setup: RampSetup, shared: SharedRecords, core: RampCore, earlier: RampReport, realtime: bool) -> None:
    stopped = _stop_flag()
    clock, port = MonotonicClock(setup.speed), SerialPort(setup.port, setup.baud)
    real = MonotonicClock()
    tick, skipped, max_late_ns, starts = earlier.tick, earlier.skipped, earlier.max_late_ns, earlier.starts + 1
    if port.open():
        core.opened(clock.now())
    due = clock.now() + setup.tick
    while not stopped:
        if core.standing_by:
            due += (STANDBY_TICKS - 1) * setup.tick
            clock.wait_for(setup.estop.number, due)
        else:
            clock.sleep_until(due)
        now = clock.now()
        received = port.read()
        out = core.tick(now, real.now(), shared.read_order(), received, _estop_signalled(setup.estop.number))
        if out:
            port.write(out)
        lateness = int((now - due) / setup.speed)
        shared.lateness[min(max(0, lateness // BUCKET_NS), BUCKETS - 1)] += 1
        max_late_ns = max(max_late_ns, lateness)
        tick += 1
        shared.write_report(core.report(tick, now, skipped, min(max_late_ns, 0xFFFFFFFF), starts, realtime, port.error))
        if core.link is LinkState.CLOSED and tick % REOPEN_EVERY == 0 and port.open():
            core.opened(clock.now())
        end = clock.now()
        shared.values.duty += DUTY_SHARE * ((end - now) / setup.tick - shared.values.duty)
        due, missed = next_due(end, due, setup.tick)
        skipped += missed
    port.close()


def _estop_signalled(estop: int) -> bool:
    try:
        os.eventfd_read(estop)
    except BlockingIOError:
        return False
    return True


def _stop_flag() -> list[int]:
    """A list that SIGTERM makes non-empty, so that the current tick is finished first."""
    flag: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: flag.append(number))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return flag


def request_realtime(priority: int) -> bool:
    """Locks the memory and requests SCHED_FIFO (0: neither); returns whether the scheduler granted it."""
    if not priority:
        return False
    ctypes.CDLL(None, use_errno=True).mlockall(MCL_CURRENT | MCL_FUTURE)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return False
    return True
