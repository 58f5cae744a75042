"""Lateness in `state/metrics`: one histogram, and percentiles that agree with it."""

from __future__ import annotations

import bisect
import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.config import load_config
from lrmd.messages.codec import MessageError, pack, unpack
from lrmd.messages.control import MetricsState
from lrmd.ramp.shared_memory import BUCKET_NS, BUCKETS
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon
from tests.support.daemon.in_memory_zenoh import InMemoryDaemon

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
    assert answer.ok is not None
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
def test_percentiles_lie_in_the_bucket_that_the_histogram_says_and_bound_the_ticks(
    daemon: InMemoryDaemon, late: list[int]
) -> None:
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
