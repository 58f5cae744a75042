"""One client's thousand goals beside everybody else's one: the ik process as it runs, asked over zenoh."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import zenoh

from lrmd.client import NoReply, RequestRefused, Rover
from lrmd.ik.process import QUEUE
from lrmd.messages.codec import ErrorReply, pack, unpack
from lrmd.messages.kinematics import CancelRequest, FkRequest, GoalEntry, IkRequest, PlanRequest
from lrmd.messages.zenoh_session import client
from tests.support.daemon.daemon_process import SLOW_BOARD, START_TIMEOUT, DaemonSetup, running_daemon, wait_for

GOAL = GoalEntry(position_m=[0.2, 0.1, 0.3])
HOG = IkRequest(id="hog", goals=[GOAL] * 1000, deadline_ms=60_000.0)
PLAN = PlanRequest(
    id="hog", from_rad=[-1.5, 1.2, 0.0, 0.0, 0.0, 0.0], to_rad=[1.5, 1.2, 0.0, 0.0, 0.0, 0.0], deadline_ms=60_000.0
)


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaemonSetup]:
    setup = DaemonSetup.make(tmp_path_factory.mktemp("daemon"), SLOW_BOARD)
    with running_daemon(setup), setup.rover() as rover:

        def answers() -> bool:
            with suppress(NoReply, RequestRefused):
                return bool(rover.ik(IkRequest(goals=[GOAL])).answers)
            return False

        wait_for(answers, "the ik process answers", START_TIMEOUT, 0.05)
        yield setup


@pytest.fixture
def rover(setup: DaemonSetup) -> Iterator[Rover]:
    with setup.rover() as rover:
        yield rover


@contextmanager
def hogged(setup: DaemonSetup, request: IkRequest | PlanRequest = HOG, times: int = 1) -> Iterator[list[Future[str]]]:
    """Another client's long questions, cancelled at the end: what they were told."""

    def told(hog: Rover) -> str:
        try:
            hog.ik(request) if isinstance(request, IkRequest) else hog.plan(request)
        except RequestRefused as error:
            return error.code
        return "answered"

    with setup.rover() as hog, ThreadPoolExecutor(times) as pool:
        questions = [pool.submit(told, hog) for _ in range(times)]
        time.sleep(0.3)
        try:
            yield questions
        finally:
            hog.cancel("hog")


def seconds(start: float) -> float:
    return time.monotonic() - start


def test_a_single_goal_is_answered_beside_a_thousand(setup: DaemonSetup, rover: Rover) -> None:
    with hogged(setup) as (hog,):
        for _ in range(5):
            assert rover.ik(IkRequest(goals=[GOAL], deadline_ms=1000.0)).answers[0].verdict == "solved"
        assert not hog.done()
    assert hog.result() == "cancelled"


def test_a_client_that_does_not_name_itself_is_served_beside_a_hog_that_does_not_either(setup: DaemonSetup) -> None:
    with zenoh.open(client([setup.endpoint])) as session:
        key, one = setup.key("rpc/ik"), pack(IkRequest(goals=[GOAL], deadline_ms=1000.0))
        hogs = session.get(key, payload=pack(HOG), timeout=60.0)
        (reply,) = session.get(key, payload=one, timeout=5.0)
        assert reply.ok is not None
        session.get(setup.key("rpc/cancel"), payload=pack(CancelRequest(id="hog")), timeout=1.0)
        (cancelled,) = hogs
        assert unpack(ErrorReply, cancelled.err.payload.to_bytes()).code == "cancelled"


def test_the_queue_has_a_place_for_a_newcomer_when_it_is_full(setup: DaemonSetup, rover: Rover) -> None:
    """All are sent at once, and nobody else is told to come again; the one with the most gives way."""
    fit, beyond = QUEUE // 1000, 20
    with hogged(setup, times=fit + beyond) as hogs:
        wait_for(lambda: sum(hog.done() for hog in hogs) >= beyond, "the hog is told that the queue is full")
        for _ in range(10):
            assert rover.ik(IkRequest(goals=[GOAL], deadline_ms=1000.0)).answers[0].verdict == "solved"
        assert sum(hog.done() for hog in hogs) == beyond + 1, "one gave way, for all ten"
    codes = [hog.result() for hog in hogs]
    assert (codes.count("busy"), codes.count("cancelled")) == (beyond + 1, fit - 1)


ASK_64_TIMES = """
import sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["' + sys.argv[1] + '"]')
with zenoh.open(config) as session:
    querier = session.declare_querier(sys.argv[2])
    payload = sys.stdin.buffer.read()
    source = zenoh.SourceInfo(querier.id, 0)
    for _ in range(64):
        session.get(sys.argv[2], lambda _: None, payload=payload, timeout=60, source_info=source)
    time.sleep(60)
"""
"""A foreign client that asks in its own name, without this package."""


def test_the_queries_of_a_client_that_is_killed_are_dropped(tmp_path: Path) -> None:
    """They would keep the ik process busy for most of a minute."""
    setup = DaemonSetup.make(tmp_path, SLOW_BOARD)
    with running_daemon(setup) as (_, daemon):
        ik = daemon.child("ik")
        command = [sys.executable, "-c", ASK_64_TIMES, setup.endpoint, setup.key("rpc/ik")]
        with subprocess.Popen(command, stdin=subprocess.PIPE) as hog:
            hog.stdin.write(pack(HOG))
            hog.stdin.close()
            wait_for(lambda: works(ik), "the ik process works on its queries", pause=0.1)
            hog.kill()
        wait_for(lambda: not works(ik), "the ik process has dropped them", pause=0.1)


def works(pid: int) -> bool:
    """Whether a process takes more than a tenth of the time that its clock of 10 ms shows within half a second."""
    before = cpu_ticks(pid)
    time.sleep(0.5)
    return cpu_ticks(pid) - before > 5


def cpu_ticks(pid: int) -> int:
    """Computing time of a process, in 10 ms."""
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return int(user) + int(system)


def test_an_expired_question_is_told_so_while_another_is_worked_on(setup: DaemonSetup, rover: Rover) -> None:
    with hogged(setup):
        began = time.monotonic()
        with pytest.raises(RequestRefused) as late:
            rover.ik(IkRequest(goals=[GOAL] * 1000, deadline_ms=100.0))
        assert late.value.code == "deadline"
        assert seconds(began) >= 0.1


def test_a_plan_does_not_block_inverse_kinematics(setup: DaemonSetup, rover: Rover) -> None:
    with hogged(setup, PLAN, times=4):
        answered = 0
        for _ in range(20):
            answered += rover.ik(IkRequest(goals=[GOAL], deadline_ms=1000.0)).answers[0].verdict == "solved"
        assert answered == 20


def test_a_thousand_poses_fit_into_the_deadline_of_fk_also_beside_a_hog(setup: DaemonSetup, rover: Rover) -> None:
    q = [[0.001 * i, 0.3, 0.4, 0.0, 0.5, 0.0] for i in range(1000)]
    assert len(rover.fk(FkRequest(q_rad=q)).places) == 1000
    with hogged(setup):
        assert len(rover.fk(FkRequest(q_rad=q)).places) == 1000
    with pytest.raises(RequestRefused) as late:
        rover.fk(FkRequest(q_rad=q, deadline_ms=1.0))
    assert late.value.code == "deadline"


def test_what_is_answered_was_answered_before_its_deadline(rover: Rover) -> None:
    """Whatever the deadline: an answer in time, by the daemon's clock, or the error."""
    outcomes = set()
    for deadline in (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0):
        for _ in range(5):
            asked = time.monotonic_ns()
            try:
                reply = rover.ik(IkRequest(goals=[GOAL], method="direct", deadline_ms=deadline))
            except RequestRefused as error:
                outcomes.add(error.code)
            else:
                assert reply.elapsed_ms <= deadline
                assert reply.t_mono_ns >= asked
                outcomes.add("answered")
    assert outcomes == {"deadline", "answered"}
