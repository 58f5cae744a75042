"""Faults while the arm moves: stops, cables, clients and processes that die."""

from __future__ import annotations

import itertools
import os
import random
import signal
import time
from bisect import bisect_left
from contextlib import suppress
from pathlib import Path

import zenoh

from bench.daemon_performance.measurement import (
    FAR,
    MS,
    NEAR,
    PerformanceFigure,
    PerformanceHarness,
    delays,
    running_harness,
    setup_with_board,
    step,
    time_when,
)
from lrm_math.errors import LrmError
from lrmd.config import load_config
from lrmd.messages.codec import Message, pack, unpack
from lrmd.messages.control import ArmRequest, EstopCommand, Event, LeaseRequest, MoveRequest, Reply
from lrmd.messages.zenoh_session import client
from tests.support.daemon.daemon_harness import HOME, wait_for_link
from tests.support.daemon.daemon_process import SECOND, DaemonProcess, DaemonSetup, children, is_alive, wait_for
from tests.support.daemon.pulse_invariants import pulse_invariants, read_frames


def estops(n: int) -> list[PerformanceFigure]:
    """Time from a put on cmd/estop by a client without lease to the frame that switches everything off."""
    requested = []
    with running_harness() as h, h.rover.control("bench"), zenoh.open(client([h.setup.endpoint])) as stranger:
        stop = stranger.declare_publisher(h.setup.key("cmd/estop"), express=True)
        for _ in range(n):
            h.arm()
            h.rover.move(FAR, wait=False)
            time.sleep(random.uniform(0.1, 0.2))
            requested.append(time.monotonic_ns())
            stop.put(pack(EstopCommand(why="bench")))
            wait_for(lambda: not any(h.rover.joints().on), "the pulses are off")
            h.rover.reset_fault()
        off = [line.t for line in h.frames() if not line.pulsing]
        return [PerformanceFigure("e-stop to the frame that stops", delays(requested, off), "ms", 13), h.step()]


def hang_ups(n: int) -> list[PerformanceFigure]:
    """The device vanishes: until the ramp has closed it, until the event, and from its return to frames again."""
    closed, events_at, back = [], [], []
    with running_harness() as h, h.rover.control("bench"):
        events: list[Event] = []
        h.rover.watch(Event, "event/link_down", events.append)
        h.arm()
        for _ in range(n):
            h.rover.move(NEAR if h.rover.joints().q_rad[0] > 0 else FAR, wait=False)
            time.sleep(random.uniform(0.3, 0.4))
            gone, let_go = _hang_up(h)
            back.append(time_when(h.setup.link.is_symlink))
            h.wait_for_mode("fault")
            wait_for_link(h.rover)
            closed.append((let_go - gone) / MS)
            events_at.append((events[-1].t_mono_ns - gone) / MS)
            h.rover.reset_fault()
        pulsing = [line.t for line in h.frames() if line.pulsing]
        return [
            PerformanceFigure("disconnect to the ramp's letting go", tuple(closed), "ms", 10),
            PerformanceFigure("- to the event", tuple(events_at), "ms"),
            PerformanceFigure("port back to pulses streaming again", delays(back, pulsing), "ms", 100),
            h.step(),
        ]


def _hang_up(h: PerformanceHarness) -> tuple[int, int]:
    """Monotonic ns at which the device vanished, and at which the ramp had closed it."""
    node = os.readlink(h.setup.link)
    files = Path(f"/proc/{h.daemon.child('ramp')}/fd")
    opened = next(file for file in files.iterdir() if _target(file) == node)
    h.board.ask("hangup 0.3")
    gone = time_when(lambda: not h.setup.link.is_symlink())
    return gone, time_when(lambda: not _target(opened).startswith(node))


def _target(link: Path) -> str:
    try:
        return os.readlink(link).removesuffix(" (deleted)")
    except OSError:
        return ""


def leases(n: int) -> list[PerformanceFigure]:
    """A client that falls silent in the middle of a move: from its last sign of life to the last change of a pulse."""
    last = []
    with running_harness() as h, zenoh.open(client([h.setup.endpoint])) as session:
        for k in range(n):
            token = _request(session, h.setup, "rpc/lease", LeaseRequest(action="acquire", holder="bench")).lease or ""
            if not k:
                h.armed_at.append(time.monotonic_ns())
                _request(session, h.setup, "rpc/arm", ArmRequest(lease=token, where="given", q_rad=HOME))
                time.sleep(0.25)
            _request(session, h.setup, "rpc/lease", LeaseRequest(action="renew", lease=token))
            _request(session, h.setup, "rpc/move", MoveRequest(lease=token, waypoints=[FAR if k % 2 else NEAR]))
            last.append(time.monotonic_ns())
            _request(session, h.setup, "rpc/lease", LeaseRequest(action="renew", lease=token))
            h.wait_for_mode("holding")
            time.sleep(1.0)  # so that the next move begins after the second in which this one ended
        changed = [b.t for a, b in itertools.pairwise(h.frames()) if a.counts != b.counts]
        stopped = [max(t for t in changed if at <= t < at + SECOND) for at in last]
        held = tuple((end - at) / MS for at, end in zip(last, stopped, strict=True))
        return [PerformanceFigure("last sign of life to hold", held, "ms", 500), h.step()]


def _request(session: zenoh.Session, setup: DaemonSetup, tail: str, request: Message) -> Reply:
    for reply in session.get(setup.key(tail), payload=pack(request), timeout=5.0):
        if reply.ok is not None:
            return unpack(Reply, reply.ok.payload.to_bytes())
    raise AssertionError(f"{tail} was refused")


def child_kills(n: int) -> list[PerformanceFigure]:
    """kill -9 of the ramp process, then of ik: how long no frame comes, and whether the arm stands with all its pulses.

    A move goes on while ik is killed.
    """
    killed, limp, held = [], 0, 0
    with running_harness() as h, h.rover.control("bench"):
        h.arm()
        for k in range(n):
            h.rover.move(FAR if k % 2 else NEAR, wait=False)
            time.sleep(0.5)
            os.kill(h.daemon.child("ik"), signal.SIGKILL)
            time.sleep(0.5)
            held += h.rover.mode().mode != "moving"
            killed.append(time.monotonic_ns())
            os.kill(h.daemon.child("ramp"), signal.SIGKILL)
            h.wait_for_mode("holding")
            wait_for_link(h.rover)
            limp += not all(h.rover.joints().on[:6])
        m, pauses = h.rover.metrics(), [_pause(at, [line.t for line in h.frames()]) for at in killed]
        return [
            PerformanceFigure(f"ramp killed {m.ramp_starts - 1} times: no frame for", tuple(pauses), "ms", 1000),
            PerformanceFigure("- times that the arm went limp", (limp,), "", 0),
            PerformanceFigure(f"- ik killed {m.ik_starts - 1} times: moves that it stopped", (held,), "", 0),
            h.step(),
        ]


def _pause(at: int, frames: list[int]) -> float:
    """The longest time (ms) without a frame that begins about `at` (ns)."""
    first = bisect_left(frames, at - 20 * MS)
    about = [(b - a) / MS for a, b in itertools.pairwise(frames[first:]) if a <= at + 20 * MS]
    return max(about)


def api_kills(n: int) -> list[PerformanceFigure]:
    """kill -9 of the api: its processes end, the board falls silent, the next daemon is disarmed and knows the pose."""
    ended, silent, off, wrong, armed_at = [], [], [], 0, []
    with setup_with_board() as (setup, board):
        servo, count_s = (config := load_config(setup.config)).servos[0], config.clock.count_s
        started, there = board.started_at(), servo.pulse_ns(0.0)
        for k in range(n):
            with DaemonProcess(setup) as daemon:
                daemon.ready()
                with setup.rover() as rover, suppress(LrmError), rover.control("bench"):
                    wait_for_link(rover)
                    wrong += rover.mode().mode != "disarmed" or any(rover.joints().on)
                    pose = rover.info().stored_rad or HOME
                    off.append(abs(servo.pulse_ns(pose["joint1"]) - there) / 1e3)
                    armed_at.append(time.monotonic_ns())
                    rover.arm("given", pose)
                    rover.move(FAR if k % 2 else NEAR, wait=False)
                    time.sleep(random.uniform(0.6, 0.9))
                    ended.append(_kill(daemon))
            wait_for(lambda: not any(board.pulses()), "the board stops by itself")
            *_, last, silence = read_frames(setup.log)
            there = round(last.counts[servo.channel] * count_s * 1e9)
            silent.append((silence.t - last.t) / MS)
        invariants = pulse_invariants(config, read_frames(setup.log))
        invariants.check([at - started for at in armed_at])
        return [
            PerformanceFigure(f"api killed {len(ended)} times: its processes end", tuple(ended), "ms"),
            PerformanceFigure("- last frame to the board's silence", tuple(silent), "ms"),
            PerformanceFigure("- pose that the next one knows is off by", tuple(off), "us", 500 / 6.5 + 1),
            PerformanceFigure("- times not disarmed at boot", (wrong,), "", 0),
            step(invariants),
        ]


def _kill(daemon: DaemonProcess) -> float:
    """kill -9; ms until all its processes have ended."""
    own, at = children(daemon.pid), time.monotonic_ns()
    daemon.signal(signal.SIGKILL)
    return (time_when(lambda: not any(map(is_alive, own))) - at) / MS
