"""Events come in bounded numbers, and no kind of event displaces another."""

from __future__ import annotations

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from lrmd.api.publisher import BURST, KEPT_EVENTS, WINDOW, EventRing, EventThrottle
from lrmd.control.state import ControllerEvent

CODES = ["refused", "mode", "lease_taken"]


def event(code: str, number: int = 0) -> ControllerEvent:
    return ControllerEvent(code, "warning", f"number {number}", {"n": number})


def published(arrivals: list[tuple[str, int]]) -> list[tuple[int, ControllerEvent]]:
    """Times and events that pass, of arrivals at times (ns), with 50 looks per second and a while at the end."""
    throttle, out, pending = EventThrottle(), [], list(arrivals)
    last = arrivals[-1][1] if arrivals else 0
    for now in range(0, last + 2 * WINDOW, WINDOW // 50):
        while pending and pending[0][1] <= now:
            code, _ = pending.pop(0)
            number = len(arrivals) - len(pending)
            if throttle.passes(event(code, number), now):
                out.append((now, event(code, number)))
        out += [(now, e) for e in throttle.due(now)]
    return out


ARRIVALS = st.lists(st.tuples(st.sampled_from(CODES), st.integers(0, 5 * WINDOW)), max_size=300).map(
    lambda rows: sorted(rows, key=lambda row: row[1])
)


@given(ARRIVALS)
def test_every_event_is_published_or_counted_and_the_last_of_each_code_is_published(arrivals) -> None:
    out = published(arrivals)
    counts = Counter[str]()
    for _, e in out:
        counts[e.code] += e.detail.get("count", 1)
    assert counts == Counter(code for code, _ in arrivals)
    for code in counts:
        last = max(n for n, (c, _) in enumerate(arrivals, start=1) if c == code)
        assert [e.detail["n"] for _, e in out if e.code == code][-1] == last


@given(ARRIVALS)
def test_no_second_has_more_than_two_windows_of_a_code(arrivals) -> None:
    out = published(arrivals)
    for code in CODES:
        times = [t for t, e in out if e.code == code]
        assert all(sum(t <= other < t + WINDOW for other in times) <= 2 * (BURST + 1) for t in times)


def test_a_few_events_pass_at_once_and_unchanged() -> None:
    throttle = EventThrottle()
    assert all(throttle.passes(event("mode", n), n) for n in range(BURST))
    assert throttle.due(10 * WINDOW) == []
    assert throttle.passes(event("mode"), 10 * WINDOW)


def test_a_flood_is_one_line_with_its_number() -> None:
    out = published([("refused", n * WINDOW // 700) for n in range(600)])
    assert len(out) == BURST + 1
    assert out[-1][1].detail["count"] == 600 - BURST
    assert out[-1][1].text.startswith("number 600 (the last of 590 in 1 s")


def test_floods_of_one_code_leave_500_events_of_others_in_the_ring() -> None:
    ring = EventRing()
    real = [f"event {n}".encode() for n in range(KEPT_EVENTS)]
    for n, data in enumerate(real):
        ring.add(("mode", "link_up", "servo_hot")[n % 3], data)
    for n in range(10 * KEPT_EVENTS):
        ring.add("refused", b"flood %d" % n)
    kept = ring.all()
    assert [data for data in kept if data.startswith(b"event")] == real
    assert len(kept) == 2 * KEPT_EVENTS
    assert kept[-1] == b"flood %d" % (10 * KEPT_EVENTS - 1)
