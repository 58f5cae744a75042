"""The queue of the ik process: whose turn it is, who gets in, and who gives way."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.errors import RequestError
from lrmd.ik.fair_queue import FairQueue

Entry = tuple[str, int, int]
"""Client, number, load."""
CLIENTS = st.sampled_from("abcdef")
STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("add"), CLIENTS, st.integers(1, 5)),
        st.tuples(st.just("next"), CLIENTS, st.just(0)),
        st.tuples(st.just("remove"), CLIENTS, st.integers(0, 20)),
    ),
    max_size=80,
)


def test_turns_go_round_the_clients_then_round_the_entries_of_each() -> None:
    queue: FairQueue[str] = FairQueue(10)
    for entry in ("a1", "a2", "a3", "b1"):
        queue.add(entry[0], entry)
    assert [queue.next() for _ in range(6)] == ["a1", "b1", "a2", "b1", "a3", "b1"]
    assert queue.next(lambda entry: entry == "a2") == "a2"
    assert queue.next(lambda entry: entry == "c") is None


@given(steps=STEPS, capacity=st.integers(5, 30))
def test_the_laws_of_admission_hold_after_any_history(steps: list[tuple[str, str, int]], capacity: int) -> None:
    """A newcomer is admitted while there are few clients; whoever gives way has more, and keeps one entry."""
    queue: FairQueue[Entry] = FairQueue(capacity, lambda entry: entry[2])
    held: dict[str, list[Entry]] = {}
    for number, (what, client, load) in enumerate(steps):
        if what == "next":
            entry = queue.next()
            assert (entry is None) == (not held)
            assert entry is None or entry in held[entry[0]]
        elif what == "remove":
            mine = held.get(client, [])
            entry = mine[load % len(mine)] if mine else (client, -1, 1)
            assert queue.remove(client, entry) == bool(mine)
            held[client] = [one for one in mine if one != entry]
        else:
            entry = (client, number, load)
            before = {name: total(entries) for name, entries in held.items()}
            try:
                pushed_out = queue.add(client, entry)
            except RequestError:
                assert sum(before.values()) + load > capacity, "refused although there was room"
                assert client in held or len(held) >= capacity // 5, "a newcomer was refused"
            else:
                for one in pushed_out:
                    assert total(held[one[0]]) > before.get(client, 0) + load, "it held no more than the one that came"
                    assert held[one[0]].pop() == one, "not its newest"
                    assert held[one[0]], "its last"
                held.setdefault(client, []).append(entry)
        held = {name: entries for name, entries in held.items() if entries}
        assert sorted(queue) == sorted(one for entries in held.values() for one in entries)
        assert sum(map(total, held.values())) <= capacity
        assert all(queue.held(name) == total(entries) for name, entries in held.items())


def total(entries: list[Entry]) -> int:
    return sum(entry[2] for entry in entries)


@given(added=st.lists(CLIENTS, min_size=1, max_size=40), removed=st.integers(0, 20))
def test_whoever_has_one_entry_has_as_many_turns_as_whoever_has_many(added: list[str], removed: int) -> None:
    queue: FairQueue[Entry] = FairQueue(100)
    for number, client in enumerate(added):
        queue.add(client, (client, number, 1))
    for entry in list(queue)[:removed]:
        queue.next()
        assert queue.remove(entry[0], entry)
        assert not queue.remove(entry[0], entry)
    entries = list(queue)
    clients = {entry[0] for entry in entries}
    most = max((sum(entry[0] == client for entry in entries) for client in clients), default=0)
    turns = [entry for _ in range(most * len(clients)) if (entry := queue.next()) is not None]
    assert Counter(entry[0] for entry in turns) == dict.fromkeys(clients, most)
    assert set(turns) == set(entries), "every entry has its turn"
    for client in clients:
        mine = Counter(entry for entry in turns if entry[0] == client)
        assert max(mine.values()) - min(mine.values()) <= 1, "the entries of a client have turns in equal numbers"


def test_two_hogs_do_not_keep_a_third_client_out() -> None:
    queue: FairQueue[Entry] = FairQueue(16_000, lambda entry: entry[2])
    for hog in "ab":
        for number in range(64):
            with suppress(RequestError):
                queue.add(hog, (hog, number, 1000))
    assert (queue.held("a"), queue.held("b")) == (8000, 8000)
    for number in range(5):
        queue.add("c", ("c", number, 1000))
    with pytest.raises(RequestError) as refused:
        queue.add("c", ("c", 5, 1000))
    assert (refused.value.code, refused.value.retryable) == ("busy", True)
    assert sorted(map(queue.held, "abc")) == [5000, 5000, 6000]
    for number in range(13):
        assert queue.add(f"new{number}", (f"new{number}", 0, 1000)), "somebody gives way"
    with pytest.raises(RequestError, match="the queue is full; ask again"):
        queue.add("one too many", ("one too many", 0, 1000))


def test_a_waiting_worker_is_woken() -> None:
    queue: FairQueue[str] = FairQueue(1)
    assert not queue.wait(0.0)
    queue.add("a", "a1")
    assert queue.wait(0.0)
    with pytest.raises(RequestError, match="ask again"):
        queue.add("a", "a2")
