"""The queue of the ik process: whose turn it is, and who gets in."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.errors import RequestError
from lrmd.ik.fair_queue import FairQueue

CLIENTS = st.sampled_from(["a", "b", "c"])


def test_turns_go_round_the_clients_then_round_the_entries_of_each() -> None:
    queue: FairQueue[str] = FairQueue(10, 10)
    for entry in ("a1", "a2", "a3", "b1"):
        queue.add(entry[0], entry)
    assert [queue.next() for _ in range(6)] == ["a1", "b1", "a2", "b1", "a3", "b1"]
    assert queue.next(lambda entry: entry == "a2") == "a2"
    assert queue.next(lambda entry: entry == "c") is None


@given(added=st.lists(CLIENTS, max_size=40), capacity=st.integers(1, 20), share=st.integers(1, 20))
def test_nobody_has_more_than_a_share_and_all_together_no_more_than_the_capacity(
    added: list[str], capacity: int, share: int
) -> None:
    queue: FairQueue[tuple[str, int]] = FairQueue(capacity, share)
    held: Counter[str] = Counter()
    for number, client in enumerate(added):
        if held.total() == capacity or held[client] == share:
            with pytest.raises(RequestError, match="ask again") as refused:
                queue.add(client, (client, number))
            assert (refused.value.code, refused.value.retryable) == ("busy", True)
        else:
            queue.add(client, (client, number))
            held[client] += 1
    assert len(queue) == len(list(queue)) == held.total()
    clients = [name for name in held if held[name]]
    turns = Counter(entry[0] for _ in range(12 * len(clients)) if (entry := queue.next()) is not None)
    assert turns == dict.fromkeys(clients, 12), "whoever has one entry has as many turns as whoever has many"
    for client, number in list(queue):
        assert queue.remove(client, (client, number))
        assert not queue.remove(client, (client, number))
    assert (queue.next(), queue.wait(0.0)) == (None, False)


def test_a_waiting_worker_is_woken() -> None:
    queue: FairQueue[str] = FairQueue(2, 1)
    queue.add("a", "a1")
    assert queue.wait(0.0)
    with pytest.raises(RequestError, match="1 queries of this client"):
        queue.add("a", "a2")
