"""How punctual the daemon is, and what it costs: start, processor, state, lateness beside 200 queries a second."""

from __future__ import annotations

import math
import os
import random
import threading
import time
from pathlib import Path
from typing import Self

import zenoh
from scipy.spatial.transform import Rotation

from bench.daemon_rig import MS, Figure, place_with_board, rig
from lrmd.client.rover import NoAnswer, Rover
from lrmd.messages.control import JointsState, MetricsState, pack
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkRequest
from lrmd.messages.kinematics import Place as PlaceEntry
from lrmd.messages.zenoh_session import client
from tests.support.daemon_process import DaemonProcess, Place

QUERIES_PER_S = 200
REST = {"joint2": math.radians(-60.0)}
"""Upright, where turning joint 6 loads nothing: stretched out, the daemon sends the arm to rest after some minutes."""


def starts(n: int) -> list[Figure]:
    """From the start of the program to READY=1."""
    took = []
    with place_with_board() as (place, _):
        for _ in range(n):
            with DaemonProcess(place) as daemon:
                took.append((daemon.notifications.wait_for("READY=1") - daemon.started) / MS)
    return [Figure("start to ready", tuple(took), "ms", 1000)]


def cpu_seconds(pid: int) -> float:
    """What a process has used of a core."""
    used = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(used[11]) + int(used[12])) / os.sysconf("SC_CLK_TCK")


def idle(seconds: float) -> list[Figure]:
    """Share of one core of the three processes together, disarmed and standing; and how old a state is on arrival."""
    ages: list[float] = []
    with rig() as r:
        pids = [r.daemon.pid, r.daemon.child("ramp"), r.daemon.child("ik")]

        def share() -> float:
            before = sum(map(cpu_seconds, pids))
            time.sleep(seconds)
            return 100 * (sum(map(cpu_seconds, pids)) - before) / seconds

        time.sleep(1.0)
        disarmed = share()
        with r.rover.control("bench"):
            r.arm()
            standing = share()
            r.rover.watch(JointsState, "state/joints", lambda s: ages.append((time.monotonic_ns() - s.t_mono_ns) / 1e3))
            time.sleep(seconds)
    return [
        Figure("processor, three processes, disarmed", (disarmed,), "%", 5),
        Figure("- armed and standing", (standing,), "%"),
        Figure("state: made to received", tuple(ages), "us"),
    ]


def lateness(minutes: float) -> list[Figure]:
    """The arm moves and 200 queries for inverse kinematics come in every second: how late the ramp's ticks are."""
    with rig() as r, r.rover.control("bench"), zenoh.open(client([r.place.endpoint])) as session:
        r.arm()
        r.rover.move(REST)
        with Asking(session, r.place, queries(r.rover)) as asking:
            turn_to_and_fro(r.rover, 60 * minutes)
        return [*punctual(r.rover.metrics()), *asking.figures(60 * minutes), r.step()]


def turn_to_and_fro(rover: Rover, seconds: float) -> None:
    """Joint 6 turns all the while, which loads no servo."""
    end, way = time.monotonic() + seconds, 1.5
    while time.monotonic() < end:
        rover.move({"joint6": way}, wait=False)
        way = -way
        while (state := rover.mode()).mode == "moving" and time.monotonic() < end:
            time.sleep(0.5)
        assert state.mode in ("moving", "armed"), f"the move ended: {state.mode} ({state.why})"


def punctual(m: MetricsState) -> list[Figure]:
    """How late the ramp was."""
    return [
        Figure(f"lateness of {m.ticks} ticks, {'' if m.realtime else 'no '}SCHED_FIFO: p50", (m.late_p50_us,), "us"),
        Figure("- p99", (m.late_p99_us,), "us", 150),
        Figure("- p99.9", (m.late_p999_us,), "us", 500),
        Figure("- the latest", (m.late_max_us,), "us"),
        Figure("- ticks skipped", (m.skipped,), ""),
        Figure("- frames that either side refused", (m.bad_frames + m.board_errors,), "", 0),
    ]


def queries(rover: Rover) -> list[bytes]:
    """Questions for poses that the arm can reach, by the method that takes about a millisecond."""
    rng = random.Random(0)
    q = [[rng.uniform(-1.0, 1.0) for _ in range(6)] for _ in range(200)]
    while True:
        try:
            places = rover.fk(FkRequest(q_rad=q)).places
        except NoAnswer:  # the daemon is ready before its ik process is
            time.sleep(0.2)
        else:
            return [pack(IkRequest(goals=[_goal(place)], method="direct")) for place in places]


def _goal(place: PlaceEntry) -> GoalEntry:
    x, y, z, w = Rotation.from_matrix(place.rotation).as_quat()
    return GoalEntry(position_m=place.tcp_m, quaternion_xyzw=[x, y, z, w])


class Asking:
    """A client that asks 200 times a second, whether answers come or not. `took`: ms, of those that were answered."""

    def __init__(self, session: zenoh.Session, place: Place, questions: list[bytes]) -> None:
        self._session, self._key, self._questions = session, place.key("rpc/ik"), questions
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

    def figures(self, seconds: float) -> list[Figure]:
        """How long the answers took."""
        trips = sorted(self.took)
        p50, p99, p999 = (trips[int(len(trips) * share)] for share in (0.5, 0.99, 0.999))
        return [
            Figure(
                f"ik: {len(trips) / seconds:.0f} answers/s, {self.refused} refused: p50",
                (p50,),
                "ms",
            ),
            Figure("- p99", (p99,), "ms", 8),
            Figure("- p99.9", (p999,), "ms"),
        ]

    def _run(self) -> None:
        due, n = time.monotonic(), 0
        while not self._over.wait(max(0.0, due - time.monotonic())):
            self._ask(self._questions[n % len(self._questions)])
            due, n = due + 1 / QUERIES_PER_S, n + 1

    def _ask(self, question: bytes) -> None:
        asked = time.monotonic_ns()

        def answered(reply: zenoh.Reply) -> None:
            if reply.ok is None:
                self.refused += 1
            else:
                self.took.append((time.monotonic_ns() - asked) / MS)

        self._session.get(self._key, answered, payload=question, timeout=2.0, express=True)
