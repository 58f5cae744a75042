"""The stepping rule, the deadlines, the shared memory, and lateness: one histogram, percentiles that agree with it."""

from __future__ import annotations

import bisect
import math
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.config import load_config
from lrmd.messages.codec import MessageError, pack, unpack
from lrmd.messages.control import MetricsState
from lrmd.ramp.process import MonotonicClock, next_due
from lrmd.ramp.shared_memory import (
    BUCKET_NS,
    BUCKETS,
    HOLD_PULSE,
    LinkState,
    RampFault,
    RampOrder,
    RampReport,
    SharedRecords,
)
from lrmd.ramp.stepping import Pace, move
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon
from tests.support.daemon.in_memory_zenoh import InMemoryDaemon

PULSE = st.integers(500_000, 2_500_000)
STRIDE = st.integers(1, 1000)
MS = 1_000_000


@st.composite
def moves(draw: st.DrawFn) -> tuple[list[int], list[int], list[int]]:
    n = draw(st.integers(1, 9))
    stride = draw(st.lists(st.integers(200, 1000), min_size=n, max_size=n))
    start = draw(st.lists(PULSE, min_size=n, max_size=n))
    reach = draw(st.lists(st.integers(-60_000, 60_000), min_size=n, max_size=n))
    return start, [s + r for s, r in zip(start, reach, strict=True)], stride


@given(moves(), st.sampled_from(Pace))
def test_a_move_takes_no_step_above_its_stride_and_ends_exactly(m, pace: Pace) -> None:
    start, target, stride = m
    going = move(start, target, stride, pace)
    stairs = [going.at(k) for k in range(going.length + 3)]
    assert stairs[0] == tuple(start)
    assert stairs[going.length] == stairs[-1] == tuple(target)
    for before, after in pairwise(stairs):
        assert all(abs(b - a) <= s for a, b, s in zip(before, after, stride, strict=True))


@given(moves())
def test_servos_of_a_move_end_together_or_each_as_soon_as_it_can(m) -> None:
    start, target, stride = m
    together, each = move(start, target, stride, Pace.TOGETHER), move(start, target, stride, Pace.EACH)
    moving = [i for i, (a, b) in enumerate(zip(start, target, strict=True)) if a != b]
    assert together.length == each.length
    assert {together.ticks[i] for i in moving} <= {together.length}
    for i in moving:
        shortest = -(-abs(target[i] - start[i]) // stride[i])
        assert each.at(shortest)[i] == target[i] != each.at(shortest - 1)[i]


@pytest.mark.slow
@given(moves(), st.sampled_from(Pace))
def test_a_move_never_turns_back(m, pace: Pace) -> None:
    going = move(*m, pace)
    for i, distance in enumerate(going.distance):
        steps = [b[i] - a[i] for a, b in pairwise(going.at(k) for k in range(going.length + 1))]
        assert all(step * distance >= 0 for step in steps)


@given(st.integers(0, 10**15), st.integers(-(10**10), 10**10), st.integers(1 * MS, 100 * MS))
def test_the_next_deadline_is_ahead_and_nothing_is_caught_up(due: int, late: int, period: int) -> None:
    now = due + late
    after, skipped = next_due(now, due, period)
    assert now < after <= now + 2 * period
    assert skipped >= 0
    if late >= -period:
        assert (after - due) % period == 0
        assert skipped == (after - due) // period - 1
    else:
        assert (after, skipped) == (now + period, 0)


@given(st.lists(st.integers(0, 30 * MS), min_size=2, max_size=200))
def test_however_late_ticks_come_there_are_never_more_than_periods_passed(delays: list[int]) -> None:
    period = 6_500_000
    now = due = 10**12
    ticks, first = 0, due
    for delay in delays:
        now = max(now, due) + delay
        ticks += 1
        due, _ = next_due(now, due, period)
    assert ticks <= (now - first) // period + 1


def test_orders_and_reports_come_out_of_shared_memory_as_they_went_in() -> None:
    shared = SharedRecords.create()
    assert shared.read_order() is None
    assert shared.read_report() is None
    order = RampOrder(7, 123, 3, 0b101, Pace.EACH, (1,) * 16, (HOLD_PULSE,) * 16, (1000,) * 16)
    report = RampReport(9, -5, 7, link=LinkState.READY, fault=RampFault.ESTOP, moving=True, position=(4,) * 16)
    shared.write_order(order)
    shared.write_report(report)
    other = SharedRecords(os.dup(shared.descriptor))
    assert other.read_order() == order
    assert other.read_report() == report
    assert len(shared.lateness) == BUCKETS


@given(st.binary(min_size=1, max_size=64), st.integers(0, 150))
def test_a_torn_record_is_never_read(noise: bytes, at: int) -> None:
    shared = SharedRecords.create()
    order = RampOrder(7, 123, 3, 0b101, Pace.EACH, (1,) * 16, (2,) * 16, (3,) * 16)
    shared.write_order(order)
    os.pwrite(shared.descriptor, noise, at)
    assert shared.read_order() in (None, order)


def test_the_ramp_process_loads_neither_numpy_nor_the_configuration() -> None:
    """So that one that died is back before the board falls silent, on slow and busy computers too."""
    heavy = {"numpy", "pydantic", "zenoh", "structlog", "lrmd.config"}
    program = f"import sys, lrmd.ramp.process; print(*sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_an_emergency_stop_ends_the_wait_of_a_ramp_that_stands_by() -> None:
    clock, estop = MonotonicClock(), os.eventfd(0, os.EFD_NONBLOCK)
    due = clock.now() + 20 * MS
    clock.wait_for(estop, due)
    assert clock.now() >= due
    os.eventfd_write(estop, 1)
    far = clock.now() + 600_000 * MS
    clock.wait_for(estop, far)
    assert clock.now() < far
    os.close(estop)


LATENESS = st.integers(0, 3_000_000) | st.integers(0, 200_000) | st.sampled_from([0, 4999, 5000, 2_554_999, 2_555_000])
"""ns"""
LAST_EDGE_US = (BUCKETS - 1) * BUCKET_NS / 1000


@pytest.fixture(scope="module")
def daemon() -> InMemoryDaemon:
    return InMemoryDaemon(SimulatedDaemon(load_config(CONFIG)))


def metrics_of(daemon: InMemoryDaemon, late: list[int]) -> MetricsState:
    """Metrics of the daemon after ticks that were so late (ns)."""
    daemon.shared.lateness[:] = memoryview(bytes(8 * BUCKETS)).cast("Q")
    for ns in late:
        daemon.shared.lateness[min(ns // BUCKET_NS, BUCKETS - 1)] += 1
    core = daemon.sim.core
    core.observe(replace(daemon.sim.report, max_late_ns=max(late, default=0)), daemon.sim.now)
    (answer,) = daemon.session.get("lrm/rover/state/metrics")
    return unpack(MetricsState, answer.ok.payload.to_bytes())


def bucket(m: MetricsState, us: float) -> int:
    """The number of the bucket that holds a lateness."""
    return bisect.bisect_right(m.late_upper_us, us)


@given(st.lists(LATENESS, min_size=1, max_size=300))
def test_every_tick_is_counted_once_in_the_bucket_between_its_edges(daemon: InMemoryDaemon, late: list[int]) -> None:
    m = metrics_of(daemon, late)
    counts = [0] * len(m.late_counts)
    for ns in late:
        counts[bucket(m, ns / 1000)] += 1
    assert m.late_counts == counts
    assert sum(m.late_counts) == m.ticks == len(late)
    assert m.late_max_us == max(late) / 1000


@given(st.lists(LATENESS, min_size=1, max_size=300))
def test_percentiles_lie_in_the_bucket_of_the_histogram(daemon: InMemoryDaemon, late: list[int]) -> None:
    m = metrics_of(daemon, late)
    for share, p in ((0.5, m.late_p50_us), (0.99, m.late_p99_us), (0.999, m.late_p999_us)):
        rank = math.ceil(share * len(late))
        exact = sorted(late)[rank - 1] / 1000
        below = sum(m.late_counts[: bucket(m, exact)])
        assert below < rank <= below + m.late_counts[bucket(m, exact)]
        if exact < LAST_EDGE_US:
            assert exact < p <= exact + BUCKET_NS / 1000
            assert p <= m.late_upper_us[bucket(m, exact)]
        else:
            assert p == m.late_max_us >= exact


def test_the_histogram_is_small_and_ends_where_the_ramp_stops_telling_apart(daemon: InMemoryDaemon) -> None:
    m = metrics_of(daemon, [])
    assert m.late_upper_us[-1] == LAST_EDGE_US
    assert {150.0, 500.0} < set(m.late_upper_us), "the edges by which the ramp is judged"
    assert len(m.late_counts) < 30
    assert (m.ticks, m.late_p999_us, m.late_max_us) == (0, 0.0, 0.0)
    many = m.model_copy(update={"late_counts": [2**32] * len(m.late_counts), "ticks": 2**32 * len(m.late_counts)})
    assert len(pack(many)) < 1000


def test_a_largest_that_lags_behind_the_counts_is_not_below_them(daemon: InMemoryDaemon) -> None:
    """A ramp that is killed between the two writes has counted a tick and not told its lateness."""
    metrics_of(daemon, [1000])
    daemon.shared.lateness[BUCKETS - 1] += 1
    m = daemon.state("state/metrics")
    assert isinstance(m, MetricsState)
    assert m.late_p999_us == m.late_max_us == LAST_EDGE_US


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"late_counts": [785]}, "late_counts"),
        ({"late_counts": [700, 80, 5]}, "one more entry"),
        ({"late_upper_us": [5.0, 5.0], "late_counts": [700, 80, 5]}, "ascends"),
        ({"late_counts": [700, 80]}, "adds up to ticks"),
        ({"late_counts": [786, -1]}, "late_counts.1"),
        ({"late_upper_us": [math.inf]}, "late_upper_us.0: input should be a finite number"),
    ],
)
def test_a_histogram_that_does_not_fit_together_is_refused(daemon: InMemoryDaemon, changes: dict, words: str) -> None:
    whole = metrics_of(daemon, [0] * 785).model_copy(update={"late_upper_us": [5.0], "late_counts": [785, 0]})
    assert unpack(MetricsState, pack(whole)) == whole
    with pytest.raises(MessageError, match=words):
        unpack(MetricsState, pack(whole.model_copy(update=changes)))
