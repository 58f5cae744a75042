"""The ramp process: the only one that has the port. It ticks, and does nothing else.

No zenoh, no logging and no files here: whoever shares an interpreter with such things is late by milliseconds.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import signal
from dataclasses import dataclass

from lrmd.link.serial_port import Port
from lrmd.ramp.clock import Clock
from lrmd.ramp.core import Board, RampCore
from lrmd.ramp.shared_fd import SharedFd
from lrmd.ramp.shared_memory import BUCKET_NS, BUCKETS, LinkState, Report, Shared
from lrmd.ramp.stepping import next_due

MCL_CURRENT, MCL_FUTURE = 1, 2
PR_SET_PDEATHSIG = 1
DUTY_SHARE = 0.01
"""Weight of the newest tick in the averaged duty."""
REOPEN_EVERY = 3
"""Ticks between two attempts to open a port that is gone."""


@dataclass(frozen=True)
class RampSetup:
    """What the ramp process is given at its start. `memory` and `estop`: the shared memory and the eventfd."""

    board: Board
    port: str
    baud: int
    tick: int
    priority: int
    speed: float
    memory: SharedFd
    estop: SharedFd


def run(setup: RampSetup) -> None:
    """The process: ticks until it is told to stop or its parent is gone."""
    die_with_parent()
    realtime = take_realtime(setup.priority)
    shared = Shared(setup.memory.number)
    core = RampCore(setup.board, shared.report())
    gc.collect()
    gc.freeze()
    gc.disable()
    with contextlib.suppress(KeyboardInterrupt):
        _loop(setup, shared, core, realtime)


def _loop(setup: RampSetup, shared: Shared, core: RampCore, realtime: bool) -> None:
    stopped = _stop_flag()
    clock, port = Clock(setup.speed), Port(setup.port, setup.baud)
    real = Clock()
    earlier = shared.report() or Report()
    tick, skipped, latest, starts = earlier.tick, earlier.skipped, earlier.latest, earlier.starts + 1
    if port.open():
        core.opened(clock.now())
    due = clock.now() + setup.tick
    while not stopped:
        clock.sleep_until(due)
        now = clock.now()
        received = port.read()
        out = core.tick(now, real.now(), shared.order(), received, _rung(setup.estop.number))
        if out:
            port.write(out)
        lateness = int((now - due) / setup.speed)
        shared.lateness[min(max(0, lateness // BUCKET_NS), BUCKETS - 1)] += 1
        latest = max(latest, lateness)
        tick += 1
        shared.tell(core.report(tick, now, skipped, min(latest, 0xFFFFFFFF), starts, realtime, port.error))
        if core.link is LinkState.CLOSED and tick % REOPEN_EVERY == 0 and port.open():
            core.opened(clock.now())
        end = clock.now()
        shared.duty += DUTY_SHARE * ((end - now) / setup.tick - shared.duty)
        due, missed = next_due(end, due, setup.tick)
        skipped += missed
    port.close()


def _rung(estop: int) -> bool:
    try:
        os.eventfd_read(estop)
    except BlockingIOError:
        return False
    return True


def _stop_flag() -> list[int]:
    """Fills when the process is asked to end, so that the tick under way is finished first."""
    flag: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: flag.append(number))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return flag


def die_with_parent() -> None:
    """Asks the kernel to end this process when its parent ends: an orphan would keep the port."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def take_realtime(priority: int) -> bool:
    """Asks for SCHED_FIFO and for memory that is never paged out; says whether it got the first."""
    if not priority:
        return False
    ctypes.CDLL(None, use_errno=True).mlockall(MCL_CURRENT | MCL_FUTURE)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return False
    return True
