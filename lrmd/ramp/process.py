"""The real-time process that owns the serial port: a periodic loop with absolute deadlines.

No zenoh, logging or files here: they would delay ticks of the same interpreter by milliseconds. No numpy and no
configuration either: a ramp that died is back before the board falls silent, also on a slow and busy computer.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import signal
from dataclasses import dataclass

from lrmd.link.serial_port import SerialPort
from lrmd.ramp.board_link import BoardSettings
from lrmd.ramp.clock import MonotonicClock
from lrmd.ramp.core import RampCore
from lrmd.ramp.parent import SharedFd, die_with_parent
from lrmd.ramp.shared_memory import BUCKET_NS, BUCKETS, LinkState, RampReport, SharedRecords
from lrmd.ramp.stepping import next_due

MCL_CURRENT, MCL_FUTURE = 1, 2
DUTY_SHARE = 0.01
"""Weight of the newest tick in the exponential moving average of the duty."""
STANDBY_TICKS = 6
"""Periods between two ticks while the ramp stands by; an emergency stop wakes it before."""
REOPEN_EVERY = 3
"""Ticks between two attempts to reopen a lost port."""


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
    core = RampCore(setup.board, shared.read_report())
    gc.collect()
    gc.freeze()
    gc.disable()
    with contextlib.suppress(KeyboardInterrupt):
        _loop(setup, shared, core, realtime)


def _loop(setup: RampSetup, shared: SharedRecords, core: RampCore, realtime: bool) -> None:
    stopped = _stop_flag()
    clock, port = MonotonicClock(setup.speed), SerialPort(setup.port, setup.baud)
    real = MonotonicClock()
    earlier = shared.read_report() or RampReport()
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
