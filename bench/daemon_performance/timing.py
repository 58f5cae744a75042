"""Start, processor share, age of states, and lateness of the ramp beside 200 queries a second."""

from __future__ import annotations

import math
import os
import random
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, Self

import zenoh
from scipy.spatial.transform import Rotation

from bench.calibrated_ik import TABLE_B2
from bench.daemon_performance.measurement import MS, PerformanceFigure, running_harness, setup_with_board
from lrmd.client import NoReply, Rover
from lrmd.messages.codec import pack
from lrmd.messages.control import JointsState, MetricsState
from lrmd.messages.kinematics import FkAnswer, FkRequest, GoalEntry, IkRequest
from lrmd.messages.zenoh_session import client
from tests.support.daemon.daemon_process import START_TIMEOUT, DaemonProcess, DaemonSetup, children

QUERIES_PER_S = 200.0
METRICS_S = 1.1
"""Metrics are a second old at most."""
Method = Literal["direct", "cube"]
THESIS_MODEL = {'# model = "/etc/lrm/model.toml"': f'model = "{TABLE_B2}"'}
"""The thesis's model (option 1) of the rover's arm, as a change of the daemon's configuration."""
REST = {"joint2": math.radians(-60.0)}
"""Upright, where turning joint 6 loads nothing: stretched out, the daemon sends the arm to rest after some minutes."""


def starts(n: int) -> list[PerformanceFigure]:
    """Time from the start of the program to READY=1, when kinematics are answered; beside a bare start of Python."""
    took, used, bare = [], [], []
    with setup_with_board() as (setup, _):
        for _ in range(n):
            bare.append(bare_start())
            with DaemonProcess(setup) as daemon:
                took.append((daemon.notifications.wait_for("READY=1", START_TIMEOUT) - daemon.started) / MS)
                used.append(1e3 * sum(map(cpu_seconds, (daemon.pid, *children(daemon.pid)))))
    ratio = statistics.median(took) / statistics.median(bare)
    return [
        PerformanceFigure("start to ready, kinematics included", tuple(took), "ms", 1000),
        PerformanceFigure("- processor time of the four processes in it", tuple(used), "ms"),
        PerformanceFigure("python -c pass", tuple(bare), "ms"),
        PerformanceFigure("- start to ready in units of that, medians", (ratio,), ""),
    ]


def bare_start() -> float:
    """Time (ms) of a Python that does nothing: machines, and minutes of one, differ by three times."""
    before = time.monotonic_ns()
    subprocess.run([sys.executable, "-c", "pass"], check=True)
    return (time.monotonic_ns() - before) / MS


def cpu_seconds(pid: int) -> float:
    """Processor time of a process (s)."""
    used = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(used[11]) + int(used[12])) / os.sysconf("SC_CLK_TCK")


def idle(seconds: float) -> list[PerformanceFigure]:
    """Share of one core of the four processes together, disarmed and standing; and how old a state is on arrival."""
    ages: list[float] = []
    with running_harness() as h:
        pids = [h.daemon.pid, *map(h.daemon.child, ("ramp", "ik", "router"))]

        def share() -> float:
            before = sum(map(cpu_seconds, pids))
            time.sleep(seconds)
            return 100 * (sum(map(cpu_seconds, pids)) - before) / seconds

        time.sleep(1.0)
        disarmed = share()
        with h.rover.control("bench"):
            h.arm()
            standing = share()
            h.rover.watch(JointsState, "state/joints", lambda s: ages.append((time.monotonic_ns() - s.t_mono_ns) / 1e3))
            time.sleep(seconds)
    return [
        PerformanceFigure("processor, four processes, standing by", (disarmed,), "%", 3),
        PerformanceFigure("- armed and standing", (standing,), "%"),
        PerformanceFigure("state: made to received", tuple(ages), "us"),
    ]


def beside_queries(
    seconds: float, method: Method = "direct", per_s: float = QUERIES_PER_S, changes: Mapping[str, str] | None = None
) -> list[PerformanceFigure]:
    """Lateness of the ramp's ticks while the arm moves and a client asks for poses that it can reach; and how long the
    answers take. `changes`: as those of `DaemonSetup.make`."""
    with running_harness(changes) as h, h.rover.control("bench"), zenoh.open(client([h.setup.endpoint])) as session:
        queries = reachable_queries(h.rover, method)
        h.arm()
        h.rover.move(REST)
        with QueryLoad(session, h.setup, queries, per_s) as load:
            swing_joint6(h.rover, seconds)
        time.sleep(METRICS_S)
        metrics = h.rover.metrics()
        assert not {"ramp_died", "ik_died"} & set(h.daemon.codes()), "a process died meanwhile"
        return [*lateness_figures(metrics), *load.figures(seconds), h.step()]


def swing_joint6(rover: Rover, seconds: float) -> None:
    """Joint 6 turns all the while, which loads no servo."""
    end, way = time.monotonic() + seconds, 1.5
    while time.monotonic() < end:
        rover.move({"joint6": way}, wait=False)
        way = -way
        while (state := rover.mode()).mode == "moving" and time.monotonic() < end:
            time.sleep(0.5)
        assert state.mode in ("moving", "armed"), f"the move ended: {state.mode} ({state.why})"


def lateness_figures(m: MetricsState) -> list[PerformanceFigure]:
    """Figures of the ramp's lateness."""
    return [
        PerformanceFigure(
            f"lateness of {m.ticks} ticks, {'' if m.realtime else 'no '}SCHED_FIFO: p50", (m.late_p50_us,), "us"
        ),
        PerformanceFigure("- p99", (m.late_p99_us,), "us", 150),
        PerformanceFigure("- p99.9", (m.late_p999_us,), "us", 500),
        PerformanceFigure("- the latest", (m.late_max_us,), "us"),
        PerformanceFigure("- ticks skipped", (m.skipped,), ""),
        PerformanceFigure("- frames that either side refused", (m.bad_frames + m.board_errors,), "", 0),
    ]


def reachable_queries(rover: Rover, method: Method) -> list[bytes]:
    """Questions for poses that the arm can reach."""
    rng = random.Random(0)
    q = [[rng.uniform(-1.0, 1.0) for _ in range(6)] for _ in range(200)]
    while True:
        try:
            answers = rover.fk(FkRequest(q_rad=q)).places
        except NoReply:  # the daemon is ready before its ik process is
            time.sleep(0.2)
        else:
            return [pack(IkRequest(goals=[_goal(answer)], method=method)) for answer in answers]


def _goal(answer: FkAnswer) -> GoalEntry:
    x, y, z, w = Rotation.from_matrix(answer.rotation).as_quat()
    return GoalEntry(position_m=answer.tcp_m, quaternion_xyzw=[x, y, z, w])


class QueryLoad:
    """A client that asks `per_s` times a second, whether answers come or not. `took`: ms, of those answered."""

    def __init__(self, session: zenoh.Session, setup: DaemonSetup, requests: list[bytes], per_s: float) -> None:
        self._period = 1 / per_s
        self._session, self._key, self._requests = session, setup.key("rpc/ik"), requests
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.took: list[float] = []
        self.refused = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def figures(self, seconds: float) -> list[PerformanceFigure]:
        """Figures of the answers' times."""
        trips = sorted(self.took)
        p50, p99, p999 = (trips[int(len(trips) * share)] for share in (0.5, 0.99, 0.999))
        return [
            PerformanceFigure(
                f"ik: {len(trips) / seconds:.0f} answers/s, {self.refused} refused: p50",
                (p50,),
                "ms",
            ),
            PerformanceFigure("- p99", (p99,), "ms", 8),
            PerformanceFigure("- p99.9", (p999,), "ms"),
        ]

    def _run(self) -> None:
        due, n = time.monotonic(), 0
        while not self._over.wait(max(0.0, due - time.monotonic())):
            self._query(self._requests[n % len(self._requests)])
            due, n = due + self._period, n + 1

    def _query(self, request: bytes) -> None:
        sent = time.monotonic_ns()

        def answered(reply: zenoh.Reply) -> None:
            if reply.ok is None:
                self.refused += 1
            else:
                self.took.append((time.monotonic_ns() - sent) / MS)

        self._session.get(self._key, answered, payload=request, timeout=2.0, express=True)
